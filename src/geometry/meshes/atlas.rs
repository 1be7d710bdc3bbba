//! Texture coordinates for a mesh: its charts side by side in one square texture.

use glam::{Vec2, Vec3};

use super::charts::{Chart, cut, for_each_cell};
use crate::geometry::Mesh;

/// Steps in search of the largest scale that fits: beyond them a texel's share is left.
const SCALE_STEPS: usize = 24;

/// A mesh's triangles laid flat in a square texture, none over another.
#[derive(Clone, Debug)]
pub struct Atlas {
    /// Texels on a side.
    pub size_px: u32,
    /// For each vertex of the unwrapped mesh the mesh's vertex that it is a copy of.
    pub vertices: Vec<u32>,
    /// Where each lies in the texture, in texels from the top left.
    pub places_px: Vec<Vec2>,
    /// `[n_triangles]` indices of unwrapped vertices, in the mesh's order.
    pub triangles: Vec<[u32; 3]>,
}

/// A texel with the place on the mesh that it shows.
#[derive(Clone, Copy, Debug)]
pub struct Texel {
    /// `y * size_px + x`.
    pub index: u32,
    /// Position on the mesh.
    pub position: Vec3,
    /// Unit shading normal there.
    pub normal: Vec3,
    /// The unwrapped vertices around it, and the share that each has in it.
    pub corners: [u32; 3],
    /// See [`Self::corners`].
    pub weights: Vec3,
}

impl Atlas {
    /// Unwraps a mesh, with `padding_px` texels around each chart; `None` when there are too many charts for the texture.
    pub fn new(mesh: &Mesh, size_px: u32, padding_px: u32) -> Option<Self> {
        let mut charts = cut(mesh);
        // Shelves waste least when neighbours are of a height; ties keep their order.
        charts.sort_by(|a, b| b.size.y.total_cmp(&a.size.y));
        let packing = |scale: f32| pack(&charts, scale, size_px, padding_px);
        let area: f32 = charts.iter().map(|chart| chart.size.x * chart.size.y).sum();
        let longest = charts.iter().map(|c| c.size.x).fold(0.0, f32::max);
        let side = area.sqrt().max(longest).max(f32::MIN_POSITIVE);
        let (mut low, mut high) = (0.0, size_px as f32 / side);
        let mut best = (0.0, packing(0.0)?);
        for _ in 0..SCALE_STEPS {
            let scale = 0.5 * (low + high);
            if let Some(corners) = packing(scale) {
                best = (scale, corners);
                low = scale;
            } else {
                high = scale;
            }
        }
        Some(assembled(mesh, &charts, best.0, &best.1, size_px))
    }

    /// Places in `[0, 1]²`, v downward as in glTF.
    pub fn uvs(&self) -> Vec<Vec2> {
        let size = self.size_px as f32;
        self.places_px.iter().map(|place| *place / size).collect()
    }

    /// The texels that show the mesh: all whose middle a triangle covers, and at least one a corner.
    pub fn texels(&self, mesh: &Mesh) -> Vec<Texel> {
        let size = self.size_px as usize;
        let mut is_taken = vec![false; size * size];
        let mut texels = Vec::new();
        let mut add = |index: usize, triangle: [u32; 3], weights: Vec3| {
            if !std::mem::replace(&mut is_taken[index], true) {
                let corner = |list: &[Vec3], k: usize| {
                    list[self.vertices[triangle[k] as usize] as usize] * weights[k]
                };
                let mix = |list: &[Vec3]| corner(list, 0) + corner(list, 1) + corner(list, 2);
                texels.push(Texel {
                    index: index as u32,
                    position: mix(&mesh.positions),
                    normal: mix(&mesh.normals).normalize_or(Vec3::Z),
                    corners: triangle,
                    weights,
                });
            }
        };
        for &triangle in &self.triangles {
            let corners = triangle.map(|v| self.places_px[v as usize]);
            for_each_cell(corners, 0.0, |x, y, weights| {
                add(y * size + x, triangle, weights);
            });
        }
        for &triangle in &self.triangles {
            for (k, v) in triangle.into_iter().enumerate() {
                let place = self.places_px[v as usize];
                let (x, y) = (place.x as usize, place.y as usize);
                add(
                    y.min(size - 1) * size + x.min(size - 1),
                    triangle,
                    Vec3::AXES[k],
                );
            }
        }
        texels
    }
}

/// The charts' lower corners on shelves from the top, in texels; `None` when they do not fit.
fn pack(charts: &[Chart], scale: f32, size_px: u32, padding_px: u32) -> Option<Vec<Vec2>> {
    let margin = 2 * padding_px + 1;
    let (mut x, mut y, mut shelf) = (0_u32, 0_u32, 0_u32);
    let mut corners = Vec::with_capacity(charts.len());
    for chart in charts {
        let [width, height] = (chart.size * scale)
            .to_array()
            .map(|v| (v.ceil() as u32).saturating_add(margin));
        if x.saturating_add(width) > size_px {
            y += shelf;
            (x, shelf) = (0, 0);
        }
        if width > size_px || y.saturating_add(height) > size_px {
            return None;
        }
        // Half a texel in, so that the outermost middles lie within the padding.
        let inset = padding_px as f32 + 0.5;
        corners.push(Vec2::new(x as f32 + inset, y as f32 + inset));
        x += width;
        shelf = shelf.max(height);
    }
    Some(corners)
}

fn assembled(mesh: &Mesh, charts: &[Chart], scale: f32, corners: &[Vec2], size_px: u32) -> Atlas {
    let mut atlas = Atlas {
        size_px,
        vertices: Vec::with_capacity(mesh.positions.len()),
        places_px: Vec::with_capacity(mesh.positions.len()),
        triangles: vec![[0; 3]; mesh.triangles.len()],
    };
    // The chart that each mesh vertex was last copied for, and its copy.
    let mut copies = vec![(usize::MAX, 0_u32); mesh.positions.len()];
    for (c, (chart, corner)) in charts.iter().zip(corners).enumerate() {
        for (&triangle, places) in chart.triangles.iter().zip(&chart.corners) {
            let corners = mesh.triangles[triangle].into_iter().zip(places);
            for (k, (vertex, place)) in corners.enumerate() {
                let copy = &mut copies[vertex as usize];
                if copy.0 != c {
                    *copy = (c, atlas.vertices.len() as u32);
                    atlas.vertices.push(vertex);
                    atlas.places_px.push(*corner + *place * scale);
                }
                atlas.triangles[triangle][k] = copy.1;
            }
        }
    }
    atlas
}

#[cfg(test)]
mod tests {
    use super::super::test_mesh::ellipsoid;
    use super::*;

    /// Every texel is covered by one triangle at most.
    fn covered_share(atlas: &Atlas) -> f32 {
        let size = atlas.size_px as usize;
        let mut count = vec![0; size * size];
        for triangle in &atlas.triangles {
            let corners = triangle.map(|v| atlas.places_px[v as usize]);
            for_each_cell(corners, 1e-3, |x, y, _| count[y * size + x] += 1);
        }
        assert!(count.iter().all(|&n| n < 2), "no triangle over another");
        count.iter().sum::<i32>() as f32 / count.len() as f32
    }

    #[test]
    fn a_ball_lies_flat_without_overlap_and_fills_the_texture() {
        let mesh = ellipsoid(Vec3::new(5.0, 0.0, 0.0), Vec3::new(1.0, 1.0, 0.6), 24);
        let atlas = Atlas::new(&mesh, 256, 2).unwrap();
        assert_eq!(atlas.triangles.len(), mesh.triangles.len(), "all triangles");
        let share = covered_share(&atlas);
        assert!(share > 0.35, "only {share} of the texture is used");
        for uv in atlas.uvs() {
            assert!(uv.min_element() > 0.0 && uv.max_element() < 1.0, "{uv}");
        }
        for (atlas_triangle, triangle) in atlas.triangles.iter().zip(&mesh.triangles) {
            assert_eq!(
                atlas_triangle.map(|v| atlas.vertices[v as usize]),
                *triangle,
                "the mesh"
            );
        }
    }

    #[test]
    fn texels_lie_on_the_surface_and_every_triangle_has_some() {
        let mesh = ellipsoid(Vec3::ZERO, Vec3::ONE, 16);
        for size in [64, 256] {
            let atlas = Atlas::new(&mesh, size, 1).unwrap();
            for texel in atlas.texels(&mesh) {
                let radius = texel.position.length();
                assert!((0.97..1.001).contains(&radius), "radius {radius}");
                assert!(
                    texel.normal.dot(texel.position / radius) > 0.99,
                    "the normal"
                );
            }
        }
    }

    #[test]
    fn layers_that_hang_together_are_laid_apart() {
        // A strip that winds up twice about z, nearly flat: seen from above it covers itself.
        let n = 48;
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        for i in 0..=n {
            let (sin, cos) = (i as f32 / n as f32 * 2.0 * std::f32::consts::TAU).sin_cos();
            let height = 0.01 * i as f32;
            positions.push(Vec3::new(cos, sin, height));
            positions.push(Vec3::new(2.0 * cos, 2.0 * sin, height));
        }
        for i in 0..n {
            let a = 2 * i;
            triangles.extend([[a, a + 1, a + 3], [a, a + 3, a + 2]]);
        }
        let mesh = Mesh::new(positions, None, triangles).unwrap();
        covered_share(&Atlas::new(&mesh, 256, 1).unwrap());
    }

    #[test]
    fn a_texture_that_is_too_small_is_refused() {
        let positions = (0..300).map(|i| Vec3::new(i as f32, (i % 3) as f32, (i * i % 7) as f32));
        let triangles = (0..100).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let mesh = Mesh::new(positions.collect(), None, triangles).unwrap();
        assert!(Atlas::new(&mesh, 16, 2).is_none(), "100 charts in 16 x 16");
        covered_share(&Atlas::new(&mesh, 512, 2).unwrap());
    }
}
