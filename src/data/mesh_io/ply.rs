//! Stanford PLY, ASCII and binary of both byte orders: positions, normals, polygon faces.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use glam::Vec3;
use ply_rs_bw::parser::Parser;
use ply_rs_bw::ply::{Property, PropertyAccess, PropertyAccessResult};

use super::{Soup, fan};
use crate::data::DataError;

/// Any line or record of the file: a vertex uses the numbers, a face the list.
#[derive(Debug, Default)]
struct Element {
    /// x, y, z, nx, ny, nz.
    numbers: [f32; 6],
    polygon: Vec<u32>,
}

impl PropertyAccess for Element {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let slot = ["x", "y", "z", "nx", "ny", "nz"]
            .iter()
            .position(|n| *n == name);
        match (slot, number(&property)) {
            (Some(slot), Some(value)) => self.numbers[slot] = value,
            _ if matches!(name, "vertex_indices" | "vertex_index") => {
                self.polygon = indices(&property);
            }
            _ => return PropertyAccessResult::Ignored,
        }
        PropertyAccessResult::Set
    }
}

/// A scalar property as `f32`.
fn number(property: &Property) -> Option<f32> {
    match property {
        Property::Float(v) => Some(*v),
        Property::Double(v) => Some(*v as f32),
        Property::Char(v) => Some(f32::from(*v)),
        Property::UChar(v) => Some(f32::from(*v)),
        Property::Short(v) => Some(f32::from(*v)),
        Property::UShort(v) => Some(f32::from(*v)),
        Property::Int(v) => Some(*v as f32),
        Property::UInt(v) => Some(*v as f32),
        _ => None,
    }
}

/// A list property as indices; negative ones become out of range, to be reported as such.
fn indices(property: &Property) -> Vec<u32> {
    fn convert<T: Copy + TryInto<u32>>(list: &[T]) -> Vec<u32> {
        list.iter()
            .map(|i| (*i).try_into().unwrap_or(u32::MAX))
            .collect()
    }
    match property {
        Property::ListInt(list) => convert(list),
        Property::ListUInt(list) => list.clone(),
        Property::ListShort(list) => convert(list),
        Property::ListUShort(list) => convert(list),
        Property::ListChar(list) => convert(list),
        Property::ListUChar(list) => convert(list),
        _ => Vec::new(),
    }
}

/// Reads the `vertex` and `face` elements; polygons become fans.
pub(super) fn read(path: &Path) -> Result<Soup, DataError> {
    let file = File::open(path).map_err(|e| DataError::io(path, e))?;
    let ply = Parser::<Element>::new()
        .read_ply(&mut BufReader::new(file))
        .map_err(|e| DataError::unusable(path, format!("not a readable PLY: {e}")))?;
    let elements = |name: &str| ply.payload.get(name).map_or(&[][..], Vec::as_slice);
    let vector = |element: &Element, at: usize| Vec3::from_slice(&element.numbers[at..]);
    let vertices = elements("vertex");
    Ok(Soup {
        positions: vertices.iter().map(|v| vector(v, 0)).collect(),
        normals: vertices.iter().map(|v| vector(v, 3)).collect(),
        triangles: elements("face")
            .iter()
            .flat_map(|face| fan(&face.polygon))
            .collect(),
    })
}
