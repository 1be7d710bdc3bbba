//! A binary glTF with a metallic-roughness material, its textures inside.
//!
//! glTF 2.0 (Khronos), sections 3.9 (materials) and 5.19; `KHR_materials_specular` where it is asked for.

use std::path::Path;

use glam::{Quat, Vec2, Vec3, Vec4};
use image::ExtendedColorType;
use serde_json::{Value, json};

use super::glb::Glb;
use crate::data::DataError;
use crate::data::photos::image::encode_png;

/// glTF's codes.
const LINEAR: u32 = 9729;
const LINEAR_MIPMAP_LINEAR: u32 = 9987;
const CLAMP_TO_EDGE: u32 = 33071;

/// A square picture of 8 bits a channel, row-major from the top left.
#[derive(Clone, Debug)]
pub struct Texture {
    /// Texels on a side.
    pub size_px: u32,
    /// `[size_px * size_px]`.
    pub texels: Vec<[u8; 3]>,
}

/// A mesh with one material.
#[derive(Clone, Debug)]
pub struct TexturedMesh {
    /// Of the object in lists.
    pub name: String,
    /// `[n]` vertices.
    pub positions: Vec<Vec3>,
    /// `[n]` unit normals.
    pub normals: Vec<Vec3>,
    /// `[n]` texture coordinates, v downward.
    pub uvs: Vec<Vec2>,
    /// Vertex indices, anticlockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// From the vertices' axes to glTF's, whose y is up.
    pub rotation: Quat,
    /// sRGB.
    pub base_color: Texture,
    /// Roughness in G, metalness in B, linear.
    pub metallic_roughness: Texture,
    /// Directions in the frame of normals and tangents, `0.5 + 0.5 xyz`, and the tangents: `[n]`, unit, and the side of the
    /// bitangent.
    pub normal_map: Option<(Texture, Vec<Vec4>)>,
    /// Reflectance of the part that is no metal, sRGB, and the factor that it is multiplied by, on top of 0.04.
    pub specular_color: Option<(Texture, f32)>,
}

/// Writes the mesh, atomically.
///
/// # Errors
/// When the system refuses, or the file would be larger than a GLB can be.
pub fn write_textured_glb(path: &Path, mesh: &TexturedMesh) -> Result<(), DataError> {
    let mut glb = Glb::default();
    let mut attributes = json!({
        "POSITION": glb.add_positions(&mesh.positions),
        "NORMAL": glb.add_attribute(mesh.normals.iter().map(Vec3::to_array)),
        "TEXCOORD_0": glb.add_attribute(mesh.uvs.iter().map(Vec2::to_array)),
    });
    let indices = glb.add_triangles(&mesh.triangles);
    if let Some((_, tangents)) = &mesh.normal_map {
        attributes["TANGENT"] = json!(glb.add_attribute(tangents.iter().map(Vec4::to_array)));
    }
    let mut pictures = vec![&mesh.base_color, &mesh.metallic_roughness];
    pictures.extend(mesh.specular_color.as_ref().map(|(texture, _)| texture));
    pictures.extend(mesh.normal_map.as_ref().map(|(texture, _)| texture));
    let mut images = Vec::new();
    for picture in &pictures {
        let (size, mut png) = (picture.size_px, Vec::new());
        let texels = picture.texels.as_flattened();
        encode_png(&mut png, size, size, texels, ExtendedColorType::Rgb8)
            .map_err(|e| DataError::io(path, e))?;
        images.push(json!({"bufferView": glb.add_file(&png), "mimeType": "image/png"}));
    }
    let textures: Vec<Value> = (0..images.len())
        .map(|source| json!({"sampler": 0, "source": source}))
        .collect();
    let mut root = json!({
        "nodes": [node(mesh)],
        "meshes": [{"name": mesh.name, "primitives": [
            {"attributes": attributes, "indices": indices, "material": 0},
        ]}],
        "materials": [material(mesh)],
        "textures": textures,
        "images": images,
        "samplers": [{"magFilter": LINEAR, "minFilter": LINEAR_MIPMAP_LINEAR,
                      "wrapS": CLAMP_TO_EDGE, "wrapT": CLAMP_TO_EDGE}],
    });
    if mesh.specular_color.is_some() {
        root["extensionsUsed"] = json!(["KHR_materials_specular"]);
    }
    glb.write(path, root)
}

fn node(mesh: &TexturedMesh) -> Value {
    let mut node = json!({"mesh": 0, "name": mesh.name});
    // A rotation by nothing only makes files differ.
    if !mesh.rotation.abs_diff_eq(Quat::IDENTITY, 1e-6) {
        node["rotation"] = json!(mesh.rotation.normalize().to_array());
    }
    node
}

fn material(mesh: &TexturedMesh) -> Value {
    // Factors are 1 where they are not said.
    let mut material = json!({
        "name": mesh.name,
        "pbrMetallicRoughness": {
            "baseColorTexture": {"index": 0},
            "metallicRoughnessTexture": {"index": 1},
        },
    });
    if let Some((_, factor)) = mesh.specular_color {
        material["extensions"] = json!({"KHR_materials_specular": {
            "specularColorFactor": [factor, factor, factor],
            "specularColorTexture": {"index": 2},
        }});
    }
    if mesh.normal_map.is_some() {
        let index = 2 + usize::from(mesh.specular_color.is_some());
        material["normalTexture"] = json!({"index": index});
    }
    material
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::read_mesh;

    fn quad() -> TexturedMesh {
        let texture = |value: u8| Texture {
            size_px: 2,
            texels: vec![[value, 1, 2], [3, 4, 5], [6, 7, 8], [9, 10, 11]],
        };
        TexturedMesh {
            name: "quad".to_owned(),
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::ONE, Vec3::Y + Vec3::Z],
            normals: vec![Vec3::Z; 4],
            uvs: vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            rotation: Quat::from_rotation_x(-std::f32::consts::FRAC_PI_2),
            base_color: texture(100),
            metallic_roughness: texture(50),
            normal_map: Some((texture(128), vec![Vec4::new(1.0, 0.0, 0.0, 1.0); 4])),
            specular_color: Some((texture(25), 2.5)),
        }
    }

    #[test]
    fn a_written_file_reads_back_with_its_textures() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("quad.glb");
        write_textured_glb(&path, &quad()).unwrap();
        // Our own reader applies the node's rotation: z up becomes y up.
        let mesh = read_mesh(&path).unwrap();
        assert!((mesh.positions[3] - Vec3::new(0.0, 1.0, -1.0)).length() < 1e-6);
        let file = gltf::Gltf::open(&path).unwrap();
        let blob = file.blob.as_ref().unwrap();
        for (image, first) in file.images().zip([100, 50, 25, 128]) {
            let gltf::image::Source::View { view, mime_type } = image.source() else {
                panic!("inside the file");
            };
            assert_eq!(mime_type, "image/png");
            let png = &blob[view.offset()..view.offset() + view.length()];
            let picture = image::load_from_memory(png).unwrap().to_rgb8();
            assert_eq!(picture.dimensions(), (2, 2));
            assert_eq!(picture.get_pixel(0, 0).0, [first, 1, 2]);
            assert_eq!(picture.get_pixel(1, 1).0, [9, 10, 11]);
        }
        assert_eq!(file.images().count(), 4, "four textures");
        let material = file.materials().next().unwrap();
        let normals = material.normal_texture().unwrap().texture();
        assert_eq!(normals.source().index(), 3);
        let primitive = file.meshes().next().unwrap().primitives().next().unwrap();
        let tangents = primitive.get(&gltf::Semantic::Tangents).unwrap();
        assert_eq!(
            (tangents.count(), tangents.dimensions()),
            (4, gltf::accessor::Dimensions::Vec4)
        );
    }
}
