//! Binary glTF 2.0 (Khronos) out. No up axis is converted.

use std::io::Write as _;
use std::path::Path;

use glam::Vec3;
use serde_json::{Value, json};

use crate::data::{DataError, write_atomically};
use crate::geometry::{Aabb, Mesh};

/// glTF's codes.
const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_BUFFER: u32 = 34963;

/// Writes positions, normals and triangles, atomically.
pub fn write_glb(path: &Path, mesh: &Mesh) -> Result<(), DataError> {
    let mut glb = Glb::default();
    let attributes = json!({
        "POSITION": glb.add_positions(&mesh.positions),
        "NORMAL": glb.add_attribute(mesh.normals.iter().map(Vec3::to_array)),
    });
    let indices = glb.add_triangles(&mesh.triangles);
    let root = json!({
        "nodes": [{"mesh": 0, "name": "object"}],
        "meshes": [{"primitives": [{"attributes": attributes, "indices": indices}]}],
    });
    glb.write(path, root)
}

/// The buffer of a file, with the views and accessors into it; each part is aligned to four bytes.
#[derive(Default)]
pub(super) struct Glb {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Glb {
    /// Adds a file, such as a PNG; its view.
    pub(super) fn add_file(&mut self, bytes: &[u8]) -> usize {
        self.add(bytes, None)
    }

    fn add(&mut self, bytes: &[u8], target: Option<u32>) -> usize {
        let mut view = json!({
            "buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len(),
        });
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        self.views.push(view);
        self.bytes.extend_from_slice(bytes);
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        self.views.len() - 1
    }

    /// Adds what each vertex has; its accessor.
    pub(super) fn add_attribute<const N: usize>(
        &mut self,
        vectors: impl ExactSizeIterator<Item = [f32; N]>,
    ) -> usize {
        let count = vectors.len();
        let bytes: Vec<u8> = vectors.flatten().flat_map(f32::to_le_bytes).collect();
        let view = self.add(&bytes, Some(ARRAY_BUFFER));
        self.accessors.push(json!({
            "bufferView": view, "componentType": FLOAT, "count": count, "type": format!("VEC{N}"),
        }));
        self.accessors.len() - 1
    }

    /// The same of positions, whose bounds have to be named.
    pub(super) fn add_positions(&mut self, positions: &[Vec3]) -> usize {
        let accessor = self.add_attribute(positions.iter().map(Vec3::to_array));
        let bounds = Aabb::from_points(positions.iter().copied());
        self.accessors[accessor]["min"] = json!(bounds.min.to_array());
        self.accessors[accessor]["max"] = json!(bounds.max.to_array());
        accessor
    }

    /// Adds vertex indices; their accessor.
    pub(super) fn add_triangles(&mut self, triangles: &[[u32; 3]]) -> usize {
        let indices = triangles.as_flattened();
        let bytes: Vec<u8> = indices.iter().flat_map(|i| i.to_le_bytes()).collect();
        let view = self.add(&bytes, Some(ELEMENT_BUFFER));
        self.accessors.push(json!({
            "bufferView": view, "componentType": UNSIGNED_INT, "count": indices.len(), "type": "SCALAR",
        }));
        self.accessors.len() - 1
    }

    /// Writes the file, atomically: the parts, and `root` with the one node and what it refers to.
    pub(super) fn write(self, path: &Path, mut root: Value) -> Result<(), DataError> {
        root["asset"] =
            json!({"version": "2.0", "generator": concat!("neif ", env!("CARGO_PKG_VERSION"))});
        root["scene"] = json!(0);
        root["scenes"] = json!([{"nodes": [0]}]);
        root["accessors"] = json!(self.accessors);
        root["bufferViews"] = json!(self.views);
        root["buffers"] = json!([{"byteLength": self.bytes.len()}]);
        let mut text = root.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let length = 12 + 8 + text.len() + 8 + self.bytes.len();
        let Ok(length) = u32::try_from(length) else {
            let problem = "larger than the 4 GiB that a GLB can hold";
            return Err(DataError::unusable(path, problem));
        };
        write_atomically(path, |file| {
            file.write_all(b"glTF")?;
            file.write_all(&2_u32.to_le_bytes())?;
            file.write_all(&length.to_le_bytes())?;
            for (kind, chunk) in [(b"JSON", &text), (b"BIN\0", &self.bytes)] {
                file.write_all(&(chunk.len() as u32).to_le_bytes())?;
                file.write_all(kind)?;
                file.write_all(chunk)?;
            }
            Ok(())
        })
        .map_err(|e| DataError::io(path, e))
    }
}
