//! Pictures from a scene: the same shading for full images, panoramas and the progressive preview.

mod accelerator;
mod aim;
mod background;
pub mod bake;
mod band;
pub mod blocked_cones;
mod camera_path;
mod causes;
pub mod diagnostic;
pub mod drawn_by;
pub mod film;
pub mod gbuffer;
#[cfg(feature = "gpu")]
pub mod gpu;
pub mod ground;
mod highlight;
mod importance;
pub mod inbox;
pub mod irradiance;
mod lamps;
pub mod metallic_roughness;
mod more_cones;
mod named;
pub mod neilf;
pub mod panorama;
pub mod parts;
pub mod picture;
pub mod point;
pub mod preview;
pub mod priority;
pub mod progressive;
pub mod reference;
#[cfg(test)]
mod region_tests;
pub mod scene;
pub mod shade;
pub mod sketch;
pub mod slice;
#[cfg(test)]
pub(crate) mod test_scene;
mod thread_clock;
mod tone_map;
pub mod trace;
pub mod turntable;
mod unwrapped;

pub use background::{BLUR_STD, Background};
pub use bake::{BakedSurface, bake, radiance_as_albedo};
pub use camera_path::CameraPath;
pub use drawn_by::{DrawnBy, GpuChoice};
pub use film::{Destination, FileKind, Film, FilmError, Shot};
pub use gbuffer::{GBuffer, PathOptions};
pub use irradiance::{DiffuseLights, trained_light};
pub use neilf::render_neilf;
pub use panorama::{PanoramaView, panorama, panorama_of};
pub use parts::{Backdrop, Parts, PartsOptions, render_parts};
pub use picture::{Picture, SeenThere, render, render_reference, render_with, see_surroundings};
pub use point::{PointValues, PointView, lobe_half_width, point_values};
pub use preview::{Passes, Preview, PreviewFrame};
pub use progressive::PreviewScene;
pub use reference::{LobeShape, ReferenceOptions};
pub use scene::{Layer, Scene};
pub use shade::{ShadeScratch, compose, shade_background, shade_object};
pub use tone_map::ToneMap;
pub use turntable::Spin;
pub use unwrapped::Unwrapped;
