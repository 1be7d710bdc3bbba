//! Geometry: rays, cameras, meshes, the ray tracer over a mesh, and sampling on the sphere.
//!
//! Knows nothing of files, photos or light. Lengths are in scene units, angles in radians.

mod aabb;
mod atlas;
mod bvh;
mod camera;
mod charts;
mod components;
mod distortion;
mod fan;
mod footprint;
mod hierarchy;
mod iso_surface;
mod mesh;
mod mesh_distances;
mod parts;
mod ray;
mod redistance;
mod sampling;
mod scalar_grid;
mod subdivision;
mod tangents;
#[cfg(test)]
pub(crate) mod test_mesh;
mod wide_bvh;

pub use aabb::Aabb;
pub use atlas::{Atlas, Texel};
pub use bvh::{Hit, SurfaceTracer, TracerRows};
pub use camera::{Camera, Projector};
pub use distortion::{Distortion, LensModel};
pub use fan::Fan;
pub use footprint::SurfaceFootprint;
pub use iso_surface::iso_surface;
pub use mesh::{Mesh, MeshError};
pub use parts::MeshParts;
pub use ray::{Ray, nearest_point};
pub use sampling::{
    GOLDEN_ANGLE, fibonacci_sphere, irradiance_directions, orthonormal_basis, sample_vmf,
};
pub use scalar_grid::{Corners, ScalarGrid};
