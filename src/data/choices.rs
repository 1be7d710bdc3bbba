//! What a person says about a capture beyond what its files say.

use std::path::PathBuf;

use glam::Vec3;
use serde::{Deserialize, Serialize};

/// Choices about reading a capture. A run keeps them, so that every command reads its capture alike.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CaptureChoices {
    /// The direction that is up in the world; estimated from how the cameras were held where absent.
    pub up: Option<Vec3>,
    /// Where in a scan (another program's radiance field) the object will stand, scene units; chosen where absent.
    pub at: Option<Vec3>,
    /// Most pixels of all photos together, in millions; larger photos are reduced while they are read.
    pub max_megapixels: f32,
    /// Every how many-th photo is for testing, whatever the files say; 0 for none.
    pub test_every: Option<u32>,
    /// A folder with `train.txt`, `val.txt` or `test.txt` (a photo's name a line) that counts instead of the
    /// capture's own splits.
    pub split_lists: Option<PathBuf>,
    /// A folder of masks, named as their photos, that count instead of the capture's own.
    pub masks: Option<PathBuf>,
}

impl Default for CaptureChoices {
    /// Up from the cameras, 100 megapixels, the capture's own splits.
    fn default() -> Self {
        Self {
            up: None,
            at: None,
            max_megapixels: 100.0,
            test_every: None,
            split_lists: None,
            masks: None,
        }
    }
}
