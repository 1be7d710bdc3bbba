//! `neif export`: the object for other programs, with baked textures, and its environment beside it.

use std::path::{Path, PathBuf};

use glam::{EulerRot, Quat, Vec3};
use neif::color::srgb_from_linear;
use neif::data::{Texture, TexturedMesh, write_textured_glb};
use neif::neif::EnvironmentTransform;
use neif::render::output::metallic_roughness::{DIELECTRIC, MetallicRoughness};
use neif::render::output::turntable::turning_point;
use neif::render::{
    BakedSurface, Scene, TrainedLight, Unwrapped, bake, environment_map, trained_light,
};

use super::env::PanoramaFile;
use crate::cli::edits::MaterialFlags;
use crate::cli::failure::Failure;
use crate::cli::{interrupt, output, scenes};

/// Texels around each chart: two levels of smaller textures do not bleed.
const PADDING_PX: u32 = 3;
/// Error of the reflectance (root mean square) from which `KHR_materials_specular` is worth a texture.
const SPECULAR_ERROR: f32 = 0.01;

#[derive(Debug, clap::Args)]
pub(crate) struct ExportArgs {
    /// The run folder
    #[arg(value_name = "RUN")]
    run: PathBuf,
    #[command(flatten)]
    material: MaterialFlags,
    /// Texels on a side of the textures
    #[arg(long, value_name = "N", default_value_t = 2048,
          value_parser = clap::value_parser!(u32).range(16..=8192))]
    texture_size: u32,
    /// Leave out the panorama of the environment (`FILE_environment.exr`)
    #[arg(long)]
    no_environment: bool,
    /// Width of that panorama in pixels; the height is half of it
    #[arg(long, value_name = "N", default_value_t = 1024,
          value_parser = clap::value_parser!(u32).range(2..=16384))]
    environment_width: u32,
    /// The file to write
    #[arg(long, value_name = "FILE.glb")]
    out: PathBuf,
}

pub(crate) fn run(args: &ExportArgs) -> Result<(), Failure> {
    scenes::check_is_glb(&args.out)?;
    let run = scenes::open_run(&args.run, None)?;
    let object = run.scene.object.as_ref().ok_or_else(|| {
        let what = "a run of an environment alone has no object to export";
        Failure::at(&args.run, what)
    })?;
    scenes::make_folder_of(&args.out)?;
    let mesh = object.tracer.mesh();
    let unwrapped = Unwrapped::new(mesh, args.texture_size, PADDING_PX).ok_or_else(|| {
        let (size, n) = (args.texture_size, mesh.triangles.len());
        Failure::unusable(anyhow::anyhow!(
            "--texture-size {size}: too small for this mesh of {n} triangles"
        ))
    })?;
    let edit = args.material.edit()?;
    let cancel = interrupt::install()?;
    // The paper's own model has none: it keeps its diffuse part whatever the light.
    let light = trained_light(&run.scene, cancel);
    interrupt::check()?;
    let (edits, atlas) = ((&edit.whole, &edit.regions), unwrapped.own_atlas());
    let baked = bake(object, edits, atlas, PADDING_PX, light.as_deref());
    let upright = z_up_from_world(run.scene.environment.up());
    let mesh = textured(&unwrapped, &baked, upright);
    write_textured_glb(&args.out, &mesh)?;
    output::line(&args.out.display().to_string())?;
    if !args.no_environment {
        let file = environment_file(&args.out);
        let light = light.as_deref();
        write_environment(&run.scene, light, (upright, args.environment_width), &file)?;
        output::line(&file.display().to_string())?;
    }
    Ok(())
}

/// `a/b.glb` becomes `a/b_environment.exr`.
fn environment_file(out: &Path) -> PathBuf {
    let stem = out.file_stem().unwrap_or_default().to_string_lossy();
    out.with_file_name(format!("{stem}_environment.exr"))
}

/// Turns the capture's up axis to +z, where Blender has it.
fn z_up_from_world(up: Vec3) -> Quat {
    Quat::from_rotation_arc(up.normalize_or(Vec3::Z), Vec3::Z)
}

/// The mesh with its textures; the vertices stay in the capture's axes and the node turns them into glTF's, y up.
fn textured(unwrapped: &Unwrapped, baked: &BakedSurface, z_up_from_world: Quat) -> TexturedMesh {
    let Unwrapped { mesh, atlas, .. } = unwrapped;
    let copied =
        |list: &[Vec3]| -> Vec<Vec3> { atlas.vertices.iter().map(|&v| list[v as usize]).collect() };
    let texture = |texels: Vec<[u8; 3]>| Texture {
        size_px: baked.size_px,
        texels,
    };
    let material = &baked.material;
    let base = material.iter().map(|m| m.base.to_array().map(srgb_code));
    let surface = material.iter().zip(&baked.roughness);
    let surface = surface.map(|(m, roughness)| [255, code(*roughness), code(m.metallic)]);
    let is_worth =
        baked.plain_error > SPECULAR_ERROR && baked.specular_error < 0.8 * baked.plain_error;
    let specular_color = is_worth.then(|| {
        let most = material.iter().map(|m| m.dielectric.max_element());
        let most = most.fold(DIELECTRIC, f32::max);
        let share = |m: &MetallicRoughness| (m.dielectric / most).to_array().map(srgb_code);
        (
            texture(material.iter().map(share).collect()),
            most / DIELECTRIC,
        )
    });
    let tangents = atlas.tangents(mesh);
    let normals = unwrapped.normal_map(&tangents, PADDING_PX);
    TexturedMesh {
        name: "object".to_owned(),
        positions: copied(&mesh.positions),
        normals: copied(&mesh.normals),
        uvs: atlas.uvs(),
        triangles: atlas.triangles.clone(),
        // From z up to y up: Blender's import undoes just this.
        rotation: Quat::from_rotation_x(-std::f32::consts::FRAC_PI_2) * z_up_from_world,
        base_color: texture(base.collect()),
        metallic_roughness: texture(surface.collect()),
        specular_color,
        normal_map: normals.map(|normals| {
            let codes = normals
                .iter()
                .map(|n| (0.5 + 0.5 * *n).to_array().map(code));
            (texture(codes.collect()), tangents)
        }),
    }
}

fn code(value: f32) -> u8 {
    (value.clamp(0.0, 1.0) * 255.0).round() as u8
}

fn srgb_code(linear: f32) -> u8 {
    code(srgb_from_linear(linear.clamp(0.0, 1.0)))
}

/// What the object's centre sees, in Blender's convention: top +z, centre +x.
fn write_environment(
    scene: &Scene,
    light: Option<&TrainedLight>,
    (z_up_from_world, width): (Quat, u32),
    file: &Path,
) -> Result<(), Failure> {
    let cancel = interrupt::install()?;
    let (z, y, x) = z_up_from_world.to_euler(EulerRot::ZYX);
    let transform = EnvironmentTransform {
        rotate_deg: Vec3::new(x, y, z).map(f32::to_degrees),
        ..EnvironmentTransform::default()
    };
    let at = z_up_from_world * turning_point(scene);
    let turned = Scene {
        transform,
        ..scene.clone()
    };
    let picture = environment_map(&turned, light, at, width, cancel);
    PanoramaFile::Exr.write(file, &picture.ok_or(Failure::Interrupted)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_up_axis_becomes_gltf_s() {
        let y_up_from_z_up = Quat::from_rotation_x(-std::f32::consts::FRAC_PI_2);
        for up in [Vec3::Z, Vec3::Y, Vec3::X, Vec3::NEG_Z, Vec3::NEG_Y] {
            let turned = y_up_from_z_up * z_up_from_world(up) * up;
            assert!((turned - Vec3::Y).length() < 1e-5, "{up} became {turned}");
        }
        // What is y up already stays as it is.
        let rotation = y_up_from_z_up * z_up_from_world(Vec3::Y);
        assert!(rotation.abs_diff_eq(Quat::IDENTITY, 1e-6), "{rotation}");
    }

    #[test]
    fn the_panorama_lies_beside_the_mesh() {
        let file = environment_file(Path::new("a/ball.v2.glb"));
        assert_eq!(file, Path::new("a/ball.v2_environment.exr"));
    }
}
