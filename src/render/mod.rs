//! Pictures from a scene: the same shading for full images, panoramas and the progressive preview.

mod background;
pub mod diagnostic;
pub mod ground;
mod highlight;
pub mod irradiance;
mod lamps;
pub mod library;
mod named;
pub mod neilf;
pub mod output;
pub mod path;
pub mod point;
pub mod preview;
#[cfg(test)]
mod region_tests;
pub mod scene;
mod standing;
#[cfg(test)]
pub(crate) mod test_scene;

pub use self::output::bake::{BakedSurface, bake};
pub use self::output::camera_path::CameraPath;
pub use self::output::film::{Destination, FileKind, Film, FilmError, Shot};
pub use self::output::panorama::{PanoramaView, environment_map, panorama, panorama_of};
pub use self::output::parts::{Backdrop, Parts, PartsOptions, render_parts};
pub use self::output::picture::{SeenThere, environment_at, render, render_reference, render_with};
pub use self::output::raster::Picture;
pub use self::output::tone_map::ToneMap;
pub use self::output::turntable::Spin;
pub use self::output::unwrapped::Unwrapped;
pub use self::path::gbuffer::{GBuffer, PathOptions};
pub use self::path::reference::{LobeShape, ReferenceOptions};
pub use self::path::scratch::ShadeScratch;
pub use self::path::shade::{compose, shade_background, shade_object};
pub use self::preview::drawn_by::{DrawnBy, GpuChoice};
pub use self::preview::request::PreviewScene;
pub use self::preview::worker::{Passes, Preview, PreviewFrame};
pub use background::{BLUR_STD, Background};
pub use irradiance::{DiffuseLights, TrainedLight, estimated_lamps, trained_light};
pub use neilf::render_neilf;
pub use point::{PointValues, PointView, lobe_half_width, point_values};
pub use scene::{Layer, Scene};
pub use standing::{Support, motion_between};
