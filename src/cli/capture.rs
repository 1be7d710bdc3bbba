//! What can be said about a capture on the command line, for every command that reads one.

use std::path::PathBuf;

use glam::Vec3;
use neif::data::CaptureChoices;

use super::values;

/// Which photos are read, and how large.
#[derive(Clone, Debug, Default, clap::Args)]
pub(crate) struct PhotoArgs {
    /// Millions of pixels that all photos together may have in memory; larger ones are reduced [default: 100]
    #[arg(long, value_name = "N", value_parser = values::positive)]
    max_megapixels: Option<f32>,
    /// Test with every N-th photo instead of those that the capture says; 0 with none
    #[arg(long, value_name = "N", value_parser = values::test_every, conflicts_with = "split_lists")]
    test_every: Option<u32>,
    /// A folder with train.txt, val.txt or test.txt (a photo's name a line) instead of the capture's own splits
    #[arg(long, value_name = "DIR")]
    split_lists: Option<PathBuf>,
    /// A folder of masks, named as their photos, instead of the capture's own: `neif masks` makes one
    #[arg(long, value_name = "DIR")]
    masks: Option<PathBuf>,
}

impl PhotoArgs {
    /// What was chosen, and where nothing was, the choices in `stored`.
    pub(crate) fn over(&self, stored: CaptureChoices) -> CaptureChoices {
        let mut choices = stored;
        choices.max_megapixels = self.max_megapixels.unwrap_or(choices.max_megapixels);
        // A run stores them, and is read from other folders later.
        let absolute = |path: &PathBuf| std::path::absolute(path).unwrap_or_else(|_| path.clone());
        if let Some(masks) = &self.masks {
            choices.masks = Some(absolute(masks));
        }
        if self.test_every.is_some() || self.split_lists.is_some() {
            choices.test_every = self.test_every;
            choices.split_lists = self.split_lists.as_ref().map(absolute);
        }
        choices
    }
}

/// How a capture is read.
#[derive(Clone, Debug, Default, clap::Args)]
pub(crate) struct CaptureArgs {
    /// Which way is up in the capture: x, y, z, -x, -y, -z or X,Y,Z [default: as the cameras were held; in a scan, across its floors and tables]
    #[arg(long, value_name = "AXIS|X,Y,Z", value_parser = values::direction, allow_hyphen_values = true)]
    pub(crate) up: Option<Vec3>,
    /// Where in a scan the object will stand: light is learned around it [default: a free place near the middle]
    #[arg(long, value_name = "X,Y,Z", value_parser = values::vector, allow_hyphen_values = true)]
    pub(crate) at: Option<Vec3>,
    #[command(flatten)]
    pub(crate) photos: PhotoArgs,
}

impl CaptureArgs {
    /// What was chosen, and the defaults.
    pub(crate) fn choices(&self) -> CaptureChoices {
        CaptureChoices {
            up: self.up,
            at: self.at,
            ..self.photos.over(CaptureChoices::default())
        }
    }

    /// Whether anything was chosen.
    pub(crate) fn is_given(&self) -> bool {
        self.choices() != CaptureChoices::default()
    }
}
