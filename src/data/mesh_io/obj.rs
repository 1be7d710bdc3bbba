//! Wavefront OBJ; materials and texture coordinates are ignored.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use glam::Vec3;

use super::Soup;
use crate::data::DataError;

/// Reads all objects of the file into one mesh; polygons become fans.
pub(super) fn read(path: &Path) -> Result<Soup, DataError> {
    let file = File::open(path).map_err(|e| DataError::io(path, e))?;
    let options = tobj::LoadOptions {
        triangulate: true,
        single_index: true,
        ignore_points: true,
        ignore_lines: true,
    };
    let no_materials = |_: &Path| Ok((Vec::new(), std::collections::HashMap::default()));
    let (models, _) = tobj::load_obj_buf(&mut BufReader::new(file), &options, no_materials)
        .map_err(|e| DataError::unusable(path, e.to_string()))?;
    let mut soup = Soup::default();
    for model in models {
        let base = soup.positions.len() as u32;
        let mesh = model.mesh;
        let n_vertices = mesh.positions.len() / 3;
        soup.positions.extend(triples(&mesh.positions));
        soup.normals.extend(triples(&mesh.normals));
        // Objects without normals get zeros, to be computed later.
        soup.normals.resize(base as usize + n_vertices, Vec3::ZERO);
        let (faces, _) = mesh.indices.as_chunks::<3>();
        soup.triangles.extend(
            faces
                .iter()
                .map(|face| face.map(|v| base.saturating_add(v))),
        );
    }
    Ok(soup)
}

fn triples(numbers: &[f32]) -> impl Iterator<Item = Vec3> + '_ {
    numbers.as_chunks::<3>().0.iter().map(|p| Vec3::from(*p))
}
