//! Mesh files: glTF, PLY and OBJ in, GLB out. Coordinates are taken as they stand: no up-axis is
//! converted, since a mesh beside a capture is in the capture's frame whatever its format says.

mod gltf;
mod obj;
mod ply;

use std::path::{Path, PathBuf};

use glam::Vec3;

use super::DataError;
use crate::geometry::Mesh;

pub use gltf::write_glb;

/// Names looked for in a capture's folder, in this order.
const NAMES: [&str; 4] = ["mesh.glb", "mesh.gltf", "mesh.ply", "mesh.obj"];

/// The mesh in a capture's folder: `mesh.glb`, `.gltf`, `.ply` or `.obj`, the first that exists.
pub fn find_mesh(root: &Path) -> Option<PathBuf> {
    NAMES
        .iter()
        .map(|name| root.join(name))
        .find(|path| path.is_file())
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
            return Err(DataError::mesh(path, problem));
        }
    };
    Mesh::new(soup.positions, Some(soup.normals), soup.triangles)
        .map_err(|e| DataError::mesh(path, e))
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
