//! Mesh files: glTF, PLY and OBJ in, GLB out. Coordinates are taken as they stand: no up-axis is
//! converted, since a mesh beside a capture is in the capture's frame whatever its format says.

mod glb;
mod gltf;
mod obj;
mod ply;
mod textured;

use std::path::{Path, PathBuf};

use glam::Vec3;

use super::DataError;
use super::files::capture_path::first_file;
use crate::geometry::Mesh;

pub use glb::write_glb;
pub use textured::{Texture, TexturedMesh, write_textured_glb};

/// Names looked for in a capture's folder, in this order.
const NAMES: [&str; 4] = ["mesh.glb", "mesh.gltf", "mesh.ply", "mesh.obj"];

/// The mesh in a capture's folder: `mesh.glb`, `.gltf`, `.ply` or `.obj`, the first that exists.
pub fn find_mesh(root: &Path) -> Option<PathBuf> {
    first_file(root, &NAMES)
}

/// Reads a mesh; the format follows the extension.
pub fn read_mesh(path: &Path) -> Result<Mesh, DataError> {
    let extension = path
        .extension()
        .map(|e| e.to_string_lossy().to_ascii_lowercase())
        .unwrap_or_default();
    let soup = match extension.as_str() {
        "glb" | "gltf" => gltf::read(path)?,
        "ply" => ply::read(path)?,
        "obj" => obj::read(path)?,
        _ => {
            let problem =
                format!("\".{extension}\" is not a mesh format; use GLB, glTF, PLY or OBJ");
            return Err(DataError::unusable(path, problem));
        }
    };
    Mesh::new(soup.positions, Some(soup.normals), soup.triangles)
        .map_err(|e| DataError::unusable(path, e.to_string()))
}

/// Vertices and faces as read, not yet checked. Normals are zero where the file has none.
#[derive(Debug, Default)]
struct Soup {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
}

/// A polygon as a fan of triangles about its first corner.
fn fan(polygon: &[u32]) -> impl Iterator<Item = [u32; 3]> + '_ {
    polygon
        .windows(2)
        .skip(1)
        .map(|pair| [polygon[0], pair[0], pair[1]])
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::data::test_asserts::assert_error;
    use crate::geometry::meshes::test_mesh::ellipsoid;

    fn write(name: &str, bytes: &[u8]) -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        (folder, path)
    }

    const PLY_QUAD: &str = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\n\
        property float y\nproperty double z\nproperty float nx\nproperty float ny\n\
        property float nz\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n\
        0 0 0 0 0 1\n1 0 0 0 0 1\n1 1 0 0 0 1\n0 1 0 0 0 1\n4 0 1 2 3\n";

    const OBJ_QUAD: &str = "mtllib none.mtl\no a\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n\
        vt 0 0\nvn 0 0 1\nusemtl m\nf 1/1/1 2/1/1 3/1/1 4/1/1\n";

    fn glb_of(mesh: &Mesh) -> Vec<u8> {
        let (_folder, path) = write("m.glb", b"");
        write_glb(&path, mesh).unwrap();
        std::fs::read(&path).unwrap()
    }

    #[test]
    fn a_written_glb_reads_back_exactly() {
        let mesh = ellipsoid(Vec3::new(1.0, 2.0, 3.0), Vec3::new(1.0, 0.5, 0.25), 9);
        let (_folder, path) = write("m.glb", &glb_of(&mesh));
        let back = read_mesh(&path).unwrap();
        assert_eq!(back.positions, mesh.positions, "positions");
        assert_eq!(back.triangles, mesh.triangles, "triangles");
        for (a, b) in back.normals.iter().zip(&mesh.normals) {
            assert!((*a - *b).length() < 1e-6, "{a} against {b}");
        }
    }

    #[test]
    fn polygons_of_ply_and_obj_become_triangles() {
        for (name, text) in [("q.ply", PLY_QUAD), ("q.obj", OBJ_QUAD)] {
            let (_folder, path) = write(name, text.as_bytes());
            let mesh = read_mesh(&path).unwrap();
            assert_eq!(mesh.triangles.len(), 2, "{name}");
            assert!((mesh.surface_area() - 1.0).abs() < 1e-6, "{name}: area");
            assert_eq!(mesh.normals, vec![Vec3::Z; mesh.normals.len()], "{name}");
        }
    }

    #[test]
    fn nodes_of_a_gltf_are_placed() {
        let mut bytes = glb_of(&ellipsoid(Vec3::ZERO, Vec3::ONE, 8));
        // Same length, so that no chunk size changes.
        let text = br#""name":"object""#;
        let at = bytes.windows(text.len()).position(|w| w == text).unwrap();
        bytes[at..at + text.len()].copy_from_slice(br#""scale":[2,3,1]"#);
        let (_folder, path) = write("m.glb", &bytes);
        let extent = read_mesh(&path).unwrap().bounds().extent();
        let off = extent.distance(Vec3::new(4.0, 6.0, 2.0));
        assert!(off < 0.01, "{extent}");
    }

    #[test]
    fn meshes_without_faces_are_refused() {
        let ply = PLY_QUAD
            .replace("element face 1", "element face 0")
            .replace("4 0 1 2 3\n", "");
        let obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
        for (name, text) in [("empty.ply", ply.as_str()), ("empty.obj", obj)] {
            let (_folder, path) = write(name, text.as_bytes());
            assert_error(read_mesh(&path), &[name, "no faces"]);
        }
    }

    #[track_caller]
    fn assert_unusable(path: &Path) {
        let mesh = read_mesh(path);
        assert!(matches!(mesh, Err(DataError::Unusable { .. })), "{mesh:?}");
    }

    #[test]
    fn indices_out_of_range_and_unknown_formats_are_refused() {
        let ply = PLY_QUAD.replace("4 0 1 2 3", "4 0 1 2 9");
        let negative = PLY_QUAD.replace("4 0 1 2 3", "4 0 1 2 -1");
        for text in [ply, negative] {
            let (_folder, path) = write("q.ply", text.as_bytes());
            assert_unusable(&path);
        }
        let (_folder, path) = write("q.stl", b"");
        assert_error(read_mesh(&path), &["not a mesh format"]);
    }

    #[test]
    fn truncated_files_are_errors_at_every_length() {
        let glb = glb_of(&ellipsoid(Vec3::ZERO, Vec3::ONE, 3));
        for length in (0..glb.len()).step_by(7) {
            let (_folder, path) = write("m.glb", &glb[..length]);
            assert!(read_mesh(&path).is_err(), "{length} of {} bytes", glb.len());
        }
        for length in 0..PLY_QUAD.len() - 2 {
            let (_folder, path) = write("m.ply", &PLY_QUAD.as_bytes()[..length]);
            assert!(read_mesh(&path).is_err(), "{length} bytes");
        }
    }

    #[test]
    fn a_gltf_that_names_missing_accessors_or_loops_is_refused() {
        let glb = glb_of(&ellipsoid(Vec3::ZERO, Vec3::ONE, 3));
        for (good, bad) in [
            (r#""POSITION":0"#, r#""POSITION":9"#),
            (
                r#""nodes":[{"mesh":0,"name":"object"}]"#,
                r#""nodes":[{"mesh":0,"children":[0]}]"#,
            ),
        ] {
            let at = glb
                .windows(good.len())
                .position(|w| w == good.as_bytes())
                .unwrap();
            let mut bytes = glb.clone();
            let padded = format!("{bad:<width$}", width = good.len());
            bytes[at..at + good.len()].copy_from_slice(padded.as_bytes());
            let (_folder, path) = write("m.glb", &bytes);
            assert_unusable(&path);
        }
    }

    proptest! {
        #[test]
        fn damaged_files_never_panic(at in 0_usize..4000, byte: u8) {
            let glb = glb_of(&ellipsoid(Vec3::ZERO, Vec3::ONE, 3));
            let files = [
                ("m.glb", glb),
                ("m.ply", PLY_QUAD.as_bytes().to_vec()),
                ("m.obj", OBJ_QUAD.as_bytes().to_vec()),
            ];
            for (name, mut bytes) in files {
                let at = at % bytes.len();
                bytes[at] = byte;
                let (_folder, path) = write(name, &bytes);
                if let Ok(mesh) = read_mesh(&path) {
                    prop_assert!(mesh.positions.iter().all(|p| p.is_finite()));
                }
            }
        }
    }
}
