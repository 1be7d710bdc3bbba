//! A binary glTF with a metallic-roughness material, its textures inside.
//!
//! glTF 2.0 (Khronos), sections 3.9 (materials) and 5.19; `KHR_materials_specular` where it is asked for.

use std::path::Path;

use glam::{Quat, Vec2, Vec3, Vec4};
use serde_json::{Value, json};

use super::gltf::write_chunks;
use crate::data::DataError;
use crate::data::photos::image::encode_png;
use crate::geometry::Aabb;

/// glTF's codes.
const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_BUFFER: u32 = 34963;
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

/// Parts of the binary chunk, each aligned to four bytes.
#[derive(Default)]
struct Binary {
    bytes: Vec<u8>,
    views: Vec<Value>,
}

impl Binary {
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

    fn add_floats(&mut self, floats: impl Iterator<Item = f32>) -> usize {
        let bytes: Vec<u8> = floats.flat_map(f32::to_le_bytes).collect();
        self.add(&bytes, Some(ARRAY_BUFFER))
    }
}

/// Writes the mesh, atomically.
///
/// # Errors
/// When the system refuses, or the file would be larger than a GLB can be.
pub fn write_textured_glb(path: &Path, mesh: &TexturedMesh) -> Result<(), DataError> {
    let mut binary = Binary::default();
    let vectors = |list: &[Vec3]| {
        let list: Vec<f32> = list.iter().flat_map(Vec3::to_array).collect();
        list.into_iter()
    };
    let positions = binary.add_floats(vectors(&mesh.positions));
    let normals = binary.add_floats(vectors(&mesh.normals));
    let uvs = binary.add_floats(mesh.uvs.iter().flat_map(Vec2::to_array));
    let tangents = mesh
        .normal_map
        .as_ref()
        .map(|(_, tangents)| binary.add_floats(tangents.iter().flat_map(Vec4::to_array)));
    let indices = mesh.triangles.iter().flatten();
    let indices: Vec<u8> = indices.flat_map(|i| i.to_le_bytes()).collect();
    let indices = binary.add(&indices, Some(ELEMENT_BUFFER));
    let mut pictures = vec![&mesh.base_color, &mesh.metallic_roughness];
    pictures.extend(mesh.specular_color.as_ref().map(|(texture, _)| texture));
    pictures.extend(mesh.normal_map.as_ref().map(|(texture, _)| texture));
    let mut images = Vec::new();
    for picture in &pictures {
        let png = encode_png(picture.size_px, picture.size_px, &picture.texels)
            .map_err(|e| DataError::io(path, e))?;
        let view = binary.add(&png, None);
        images.push(json!({"bufferView": view, "mimeType": "image/png"}));
    }
    let bounds = Aabb::from_points(mesh.positions.iter().copied());
    let n_vertices = mesh.positions.len();
    let textures: Vec<Value> = (0..images.len())
        .map(|source| json!({"sampler": 0, "source": source}))
        .collect();
    let mut root = json!({
        "asset": {"version": "2.0", "generator": concat!("neif ", env!("CARGO_PKG_VERSION"))},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [node(mesh)],
        "meshes": [{"name": mesh.name, "primitives": [{
            "attributes": {"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2},
            "indices": 3,
            "material": 0,
        }]}],
        "materials": [material(mesh)],
        "textures": textures,
        "images": images,
        "samplers": [{"magFilter": LINEAR, "minFilter": LINEAR_MIPMAP_LINEAR,
                      "wrapS": CLAMP_TO_EDGE, "wrapT": CLAMP_TO_EDGE}],
        "accessors": [
            {"bufferView": positions, "componentType": FLOAT, "count": n_vertices, "type": "VEC3",
             "min": bounds.min.to_array(), "max": bounds.max.to_array()},
            {"bufferView": normals, "componentType": FLOAT, "count": n_vertices, "type": "VEC3"},
            {"bufferView": uvs, "componentType": FLOAT, "count": n_vertices, "type": "VEC2"},
            {"bufferView": indices, "componentType": UNSIGNED_INT,
             "count": 3 * mesh.triangles.len(), "type": "SCALAR"},
        ],
        "bufferViews": binary.views,
        "buffers": [{"byteLength": binary.bytes.len()}],
    });
    if let Some(view) = tangents {
        root["accessors"].as_array_mut().into_iter().for_each(|accessors| {
            accessors.push(json!({"bufferView": view, "componentType": FLOAT, "count": n_vertices, "type": "VEC4"}));
        });
        root["meshes"][0]["primitives"][0]["attributes"]["TANGENT"] = json!(4);
    }
    if mesh.specular_color.is_some() {
        root["extensionsUsed"] = json!(["KHR_materials_specular"]);
    }
    write_chunks(path, &root, &binary.bytes)
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
