//! A photo's depth map where the photo was taken: its camera may be another.

use std::sync::Arc;

use crate::data::{DataError, DepthMap, Frame};
use crate::geometry::Camera;

/// A training photo's depth map.
#[derive(Clone, Debug)]
pub struct DepthView {
    /// The photo's name, as its view's.
    pub name: String,
    source: Source,
}

#[derive(Clone, Debug)]
enum Source {
    /// In a file, not yet read.
    File(Box<Frame>),
    /// Rendered with the photo.
    Rendered(Arc<DepthMap>),
}

impl DepthView {
    /// That of a frame, where it has one.
    pub(in crate::data) fn of(frame: &Frame) -> Option<Self> {
        frame.depth.is_some().then(|| Self {
            name: frame.name.clone(),
            source: Source::File(Box::new(frame.clone())),
        })
    }

    /// The map of a photo that was rendered: known wherever something is seen.
    pub fn rendered(name: String, map: DepthMap) -> Self {
        let source = Source::Rendered(Arc::new(map));
        Self { name, source }
    }

    /// Whether it knows the depth of all that the photo shows.
    pub fn is_complete(&self) -> bool {
        matches!(self.source, Source::Rendered(_))
    }

    /// Reads the map. `photo_camera` is that of the photo, in any size.
    ///
    /// # Errors
    /// When the file cannot be read or is no depth map.
    pub fn read(&self, photo_camera: &Camera) -> Result<Arc<DepthMap>, DataError> {
        let frame = match &self.source {
            Source::Rendered(map) => return Ok(Arc::clone(map)),
            Source::File(frame) => frame,
        };
        let missing = || frame.error("depth", "missing");
        let file = frame.depth.as_ref().ok_or_else(missing)?;
        let (width, height, depths) = file.read()?;
        let camera = match file.lens {
            None => photo_camera.resized(width, height),
            Some(intrinsics) => {
                let frame = Frame {
                    intrinsics,
                    ..Frame::clone(frame)
                };
                frame.camera(width, height)?.0
            }
        };
        Ok(Arc::new(DepthMap { camera, depths }))
    }
}
