//! Geometry: rays, cameras, meshes, the ray tracer over a mesh, and sampling on the sphere.
//!
//! Knows nothing of files, photos or light. Lengths are in scene units, angles in radians.

mod aabb;
mod camera;
mod convex_set;
mod distortion;
mod grids;
pub(crate) mod meshes;
mod sampling;
mod tracing;

pub use self::grids::iso_surface::iso_surface;
pub use self::grids::scalar_grid::{Corners, ScalarGrid};
pub use self::meshes::atlas::{Atlas, Texel};
pub use self::meshes::mesh::{Mesh, MeshError};
pub use self::meshes::parts::MeshParts;
pub use self::tracing::bvh::{Hit, SurfaceTracer, TracerRows};
pub use self::tracing::fan::Fan;
pub use self::tracing::footprint::SurfaceFootprint;
pub use self::tracing::ray::{Ray, nearest_point};
pub use aabb::Aabb;
pub use camera::{Camera, Projector};
pub use convex_set::ConvexSet;
pub use distortion::{Distortion, LensModel};
pub use sampling::{
    GOLDEN_ANGLE, fibonacci_sphere, irradiance_directions, orthonormal_basis, sample_vmf,
};
