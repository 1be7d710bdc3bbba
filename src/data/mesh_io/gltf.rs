//! glTF 2.0, `.glb` and `.gltf`: all meshes of the scene, node transforms applied.

use std::path::Path;

use glam::{Affine3A, Mat4, Vec3};
use gltf::accessor::{DataType, Dimensions};
use gltf::mesh::{Mode, Semantic};
use serde_json::Value;

use super::Soup;
use crate::data::DataError;

/// Deepest nesting of nodes followed; recursion beyond would overflow the stack.
const MAX_DEPTH: usize = 64;

/// Reads every triangle primitive of the default scene into one mesh.
pub(super) fn read(path: &Path) -> Result<Soup, DataError> {
    let bytes = std::fs::read(path).map_err(|e| DataError::io(path, e))?;
    let text = json_chunk(path, &bytes)?;
    check_accessor_indices(path, text)?;
    let fail = |e: gltf::Error| DataError::unusable(path, format!("not a readable glTF: {e}"));
    let file = gltf::Gltf::from_slice(&bytes).map_err(fail)?;
    let buffers = gltf::import_buffers(&file.document, path.parent(), file.blob).map_err(fail)?;
    let document = file.document;
    let mut reader = Reader {
        path,
        buffers: &buffers,
        soup: Soup::default(),
        n_nodes_left: document.nodes().count(),
    };
    let scene = document
        .default_scene()
        .or_else(|| document.scenes().next());
    match scene {
        Some(scene) => {
            for node in scene.nodes() {
                reader.add_node(&node, Affine3A::IDENTITY, 0)?;
            }
        }
        // A file may hold meshes and no scene; then they stand as they are.
        None => {
            for mesh in document.meshes() {
                reader.add_mesh(&mesh, Affine3A::IDENTITY)?;
            }
        }
    }
    Ok(reader.soup)
}

/// The JSON text of a `.gltf`, or of a `.glb` whose lengths are true: the parser would allocate
/// whatever the header claims.
fn json_chunk<'a>(path: &Path, bytes: &'a [u8]) -> Result<&'a [u8], DataError> {
    if !bytes.starts_with(b"glTF") {
        return Ok(bytes);
    }
    let number = |at: usize| {
        let word = bytes.get(at..at + 4)?.first_chunk::<4>()?;
        Some(u32::from_le_bytes(*word) as usize)
    };
    let whole = number(8).is_some_and(|length| (20..=bytes.len()).contains(&length));
    number(12)
        .filter(|_| whole)
        .and_then(|length| bytes.get(20..20_usize.checked_add(length)?))
        .ok_or_else(|| DataError::unusable(path, "the GLB is truncated"))
}

/// Refuses primitives that name accessors which do not exist.
///
/// The crate's own validation looks POSITION accessors up without checking, and panics.
fn check_accessor_indices(path: &Path, text: &[u8]) -> Result<(), DataError> {
    let root: Value = serde_json::from_slice(text)
        .map_err(|e| DataError::unusable(path, format!("not valid JSON inside: {e}")))?;
    let list = |value: &Value, field: &str| match value.get(field) {
        Some(Value::Array(list)) => list.clone(),
        _ => Vec::new(),
    };
    let n_accessors = list(&root, "accessors").len() as u64;
    for primitive in list(&root, "meshes")
        .iter()
        .flat_map(|mesh| list(mesh, "primitives"))
    {
        let attributes = primitive.get("attributes").and_then(Value::as_object);
        let named = attributes.into_iter().flat_map(|map| map.values());
        for index in named.chain(primitive.get("indices")) {
            if index.as_u64().is_none_or(|index| index >= n_accessors) {
                let problem = format!("there is no accessor {index}");
                return Err(DataError::unusable(path, problem));
            }
        }
    }
    Ok(())
}

/// Collects primitives while walking the nodes.
struct Reader<'a> {
    path: &'a Path,
    buffers: &'a [gltf::buffer::Data],
    soup: Soup,
    /// A tree visits each node once; a file that visits more has cycles or shared children.
    n_nodes_left: usize,
}

impl Reader<'_> {
    fn add_node(
        &mut self,
        node: &gltf::Node<'_>,
        world_from_parent: Affine3A,
        depth: usize,
    ) -> Result<(), DataError> {
        if depth > MAX_DEPTH || self.n_nodes_left == 0 {
            return Err(self.error("the nodes are no tree, or nested too deep"));
        }
        self.n_nodes_left -= 1;
        let parent_from_node = Mat4::from_cols_array_2d(&node.transform().matrix());
        let world_from_node = world_from_parent * Affine3A::from_mat4(parent_from_node);
        if let Some(mesh) = node.mesh() {
            self.add_mesh(&mesh, world_from_node)?;
        }
        for child in node.children() {
            self.add_node(&child, world_from_node, depth + 1)?;
        }
        Ok(())
    }

    fn add_mesh(
        &mut self,
        mesh: &gltf::Mesh<'_>,
        world_from_mesh: Affine3A,
    ) -> Result<(), DataError> {
        for primitive in mesh.primitives() {
            self.add_primitive(&primitive, world_from_mesh)?;
        }
        Ok(())
    }

    fn add_primitive(
        &mut self,
        primitive: &gltf::Primitive<'_>,
        world_from_mesh: Affine3A,
    ) -> Result<(), DataError> {
        for (semantic, accessor) in primitive.attributes() {
            if matches!(semantic, Semantic::Positions | Semantic::Normals) {
                self.check_accessor(&accessor, Dimensions::Vec3, &[DataType::F32])?;
            }
        }
        if let Some(accessor) = primitive.indices() {
            let integers = [DataType::U8, DataType::U16, DataType::U32];
            self.check_accessor(&accessor, Dimensions::Scalar, &integers)?;
        }
        let buffers = self.buffers;
        let reader = primitive.reader(|buffer| buffers.get(buffer.index()).map(|data| &data.0[..]));
        let Some(positions) = reader.read_positions() else {
            return Err(self.error("a primitive has no readable POSITION"));
        };
        let base = self.soup.positions.len();
        let local: Vec<Vec3> = positions.map(Vec3::from).collect();
        let n_vertices = local.len();
        let mut normals: Vec<Vec3> = reader
            .read_normals()
            .map(|normals| normals.map(Vec3::from).collect())
            .unwrap_or_default();
        normals.resize(n_vertices, Vec3::ZERO);
        let indices: Vec<u32> = match reader.read_indices() {
            Some(indices) => indices.into_u32().collect(),
            None => (0..n_vertices as u32).collect(),
        };
        let mirrored = world_from_mesh.matrix3.determinant() < 0.0;
        for [a, b, c] in triangles(primitive.mode(), &indices) {
            let face = if mirrored { [a, c, b] } else { [a, b, c] };
            // An index beyond this primitive must not reach into the next one's vertices.
            if let Some(bad) = face.iter().find(|v| **v as usize >= n_vertices) {
                return Err(self.error(format!(
                    "a face names vertex {bad} of a primitive with {n_vertices} vertices"
                )));
            }
            self.soup.triangles.push(face.map(|v| v + base as u32));
        }
        let placed = local.iter().map(|p| world_from_mesh.transform_point3(*p));
        self.soup.positions.extend(placed);
        self.soup.normals.extend(normals.iter().map(|n| {
            // Normals go by the inverse transpose; a flat transform leaves none.
            let inverse = world_from_mesh.matrix3.inverse();
            if inverse.is_finite() {
                Vec3::from(inverse.transpose() * glam::Vec3A::from(*n))
            } else {
                Vec3::ZERO
            }
        }));
        Ok(())
    }

    /// Refuses accessors of another type, or that would overrun their buffer: the crate only
    /// asserts that they do not.
    fn check_accessor(
        &self,
        accessor: &gltf::Accessor<'_>,
        dimensions: Dimensions,
        data_types: &[DataType],
    ) -> Result<(), DataError> {
        if accessor.dimensions() != dimensions || !data_types.contains(&accessor.data_type()) {
            return Err(self.error(format!("accessor {} has the wrong type", accessor.index())));
        }
        let Some(view) = accessor.view().filter(|_| accessor.sparse().is_none()) else {
            return Err(self.error("sparse accessors are not supported"));
        };
        let length = self
            .buffers
            .get(view.buffer().index())
            .map_or(0, |b| b.len());
        let stride = view.stride().unwrap_or_else(|| accessor.size());
        let end = accessor
            .count()
            .checked_sub(1)
            .and_then(|last| last.checked_mul(stride))
            .and_then(|offset| offset.checked_add(accessor.offset()))
            .and_then(|offset| offset.checked_add(accessor.size()));
        let fits = stride >= accessor.size()
            && end.is_some_and(|end| end <= view.length())
            && view
                .offset()
                .checked_add(view.length())
                .is_some_and(|end| end <= length);
        if fits {
            Ok(())
        } else {
            Err(self.error(format!("accessor {} overruns its buffer", accessor.index())))
        }
    }

    fn error(&self, problem: impl Into<String>) -> DataError {
        DataError::unusable(self.path, problem)
    }
}

/// The triangles of a primitive; points and lines have none.
fn triangles(mode: Mode, indices: &[u32]) -> Vec<[u32; 3]> {
    match mode {
        Mode::Triangles => indices.as_chunks::<3>().0.to_vec(),
        Mode::TriangleStrip => indices
            .windows(3)
            .enumerate()
            .map(|(i, w)| {
                if i % 2 == 0 {
                    [w[0], w[1], w[2]]
                } else {
                    [w[1], w[0], w[2]]
                }
            })
            .collect(),
        Mode::TriangleFan => super::fan(indices).collect(),
        Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip => Vec::new(),
    }
}
