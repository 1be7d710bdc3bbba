//! The object's mesh as other programs get it: unwrapped, with what subdividing added as a normal map.

use std::sync::Arc;

use glam::{Vec3, Vec4};

use super::bake::grow;
use crate::geometry::{Atlas, Mesh};

/// A mesh laid flat in a texture, and the finer one that it stands for in the same texture.
#[derive(Clone, Debug)]
pub struct Unwrapped {
    /// What is written.
    pub mesh: Arc<Mesh>,
    /// Where it lies in the texture.
    pub atlas: Atlas,
    /// Where the object's own mesh lies in it, where that is finer.
    finer: Option<(Arc<Mesh>, Atlas)>,
}

impl Unwrapped {
    /// Unwraps an object's mesh, as it was before it was subdivided, with `padding_px` texels around each chart; `None` when
    /// there are too many charts for the texture.
    pub fn new(mesh: &Arc<Mesh>, size_px: u32, padding_px: u32) -> Option<Self> {
        let coarser = |mesh: &Arc<Mesh>| mesh.undivided().map(Arc::new);
        let mut levels: Vec<_> = std::iter::successors(Some(Arc::clone(mesh)), coarser).collect();
        let coarsest = levels.pop()?;
        let atlas = Atlas::new(&coarsest, size_px, padding_px)?;
        let mut of_finer = None;
        for finer in levels.into_iter().rev() {
            let of_coarser = of_finer.as_ref().map_or(&atlas, |(_, atlas)| atlas);
            let subdivided = of_coarser.subdivided(&finer);
            of_finer = Some((finer, subdivided));
        }
        Some(Self {
            mesh: coarsest,
            atlas,
            finer: of_finer,
        })
    }

    /// Where the object's own mesh lies in the texture.
    pub fn own_atlas(&self) -> &Atlas {
        self.finer.as_ref().map_or(&self.atlas, |(_, atlas)| atlas)
    }

    /// The finer mesh's normals in the frame of the written one's normals and [`Atlas::tangents`], row-major from the top left,
    /// unit, continued `padding_px` texels around what shows the mesh; `None` where there is no finer mesh.
    pub fn normal_map(&self, tangents: &[Vec4], padding_px: u32) -> Option<Vec<Vec3>> {
        let (finer, of_finer) = self.finer.as_ref()?;
        let size = self.atlas.size_px as usize;
        let mut normals: Vec<Option<Vec3>> = vec![None; size * size];
        for texel in of_finer.texels(finer) {
            normals[texel.index as usize] = Some(texel.normal);
        }
        let mut map: Vec<Option<Vec3>> = vec![None; size * size];
        for texel in self.atlas.texels(&self.mesh) {
            let index = texel.index as usize;
            let corners = texel.corners.iter().zip(texel.weights.to_array());
            let mixed: Vec4 = corners
                .map(|(v, weight)| tangents[*v as usize] * weight)
                .sum();
            let tangent = mixed.truncate().reject_from_normalized(texel.normal);
            let tangent = tangent.normalize_or(texel.normal.any_orthonormal_vector());
            let bitangent = mixed.w.signum() * texel.normal.cross(tangent);
            map[index] = normals[index].map(|normal| {
                let in_frame = [tangent, bitangent, texel.normal].map(|axis| axis.dot(normal));
                Vec3::from(in_frame)
            });
        }
        for _ in 0..=padding_px {
            grow(&mut map, size, |around| {
                around.sum::<Vec3>().normalize_or(Vec3::Z)
            });
        }
        let filled = map.into_iter().map(|normal| normal.unwrap_or(Vec3::Z));
        Some(filled.collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::meshes::test_mesh::ellipsoid;

    #[test]
    fn a_normal_map_holds_the_finer_normals_of_a_subdivided_mesh() {
        let ball = Arc::new(ellipsoid(Vec3::ZERO, Vec3::ONE, 16));
        let plain = Unwrapped::new(&ball, 64, 2).unwrap();
        assert!(plain.normal_map(&plain.atlas.tangents(&ball), 2).is_none());
        let mut finer = ball.subdivided();
        for (position, normal) in finer.positions.iter().zip(&mut finer.normals) {
            let ripple = Vec3::new((23.0 * position.y).sin(), (19.0 * position.z).sin(), 0.0);
            *normal = (*normal + 0.2 * ripple).normalize_or_zero();
        }
        let finer = Arc::new(finer);
        let unwrapped = Unwrapped::new(&finer, 256, 2).unwrap();
        assert_eq!(unwrapped.mesh.triangles, ball.triangles);
        let tangents = unwrapped.atlas.tangents(&unwrapped.mesh);
        let map = unwrapped.normal_map(&tangents, 2).unwrap();
        let mut normals = vec![None; map.len()];
        for texel in unwrapped.own_atlas().texels(&finer) {
            normals[texel.index as usize] = Some(texel.normal);
        }
        let mut n_texels = 0;
        for texel in unwrapped.atlas.texels(&unwrapped.mesh) {
            let Some(wanted) = normals[texel.index as usize] else {
                continue;
            };
            // As a shader reads it.
            let corners = texel.corners.iter().zip(texel.weights.to_array());
            let tangent: Vec4 = corners
                .map(|(v, share)| tangents[*v as usize] * share)
                .sum();
            let bitangent = tangent.w.signum() * texel.normal.cross(tangent.truncate());
            let read = map[texel.index as usize];
            let shown = read.x * tangent.truncate() + read.y * bitangent + read.z * texel.normal;
            let off = shown.normalize_or_zero().angle_between(wanted);
            assert!(off < 0.03, "{off} radians off at {texel:?}");
            n_texels += 1;
        }
        assert!(n_texels > 10_000, "{n_texels} texels");
    }
}
