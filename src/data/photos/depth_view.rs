//! A photo's depth map where the photo was taken: its camera may be another.

use crate::data::{DataError, DepthMap, Frame};
use crate::geometry::Camera;

/// A training photo's depth map, not yet read.
#[derive(Clone, Debug)]
pub struct DepthView {
    /// The photo's name, as its view's.
    pub name: String,
    frame: Frame,
}

impl DepthView {
    /// That of a frame, where it has one.
    pub(in crate::data) fn of(frame: &Frame) -> Option<Self> {
        frame.depth.is_some().then(|| Self {
            name: frame.name.clone(),
            frame: frame.clone(),
        })
    }

    /// Reads the map. `photo_camera` is that of the photo, in any size.
    ///
    /// # Errors
    /// When the file cannot be read or is no depth map.
    pub fn read(&self, photo_camera: &Camera) -> Result<DepthMap, DataError> {
        let missing = || self.frame.error("depth", "missing");
        let file = self.frame.depth.as_ref().ok_or_else(missing)?;
        let (width, height, depths) = file.read()?;
        let camera = match file.lens {
            None => photo_camera.resized(width, height),
            Some(intrinsics) => {
                let frame = Frame {
                    intrinsics,
                    ..self.frame.clone()
                };
                frame.camera(width, height)?.0
            }
        };
        Ok(DepthMap { camera, depths })
    }
}
