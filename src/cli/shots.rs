//! Where pictures are taken from: photos' places, files of cameras, turntables, camera paths.

use std::path::PathBuf;

use anyhow::anyhow;
use glam::Vec3;
use neif::data::{Split, read_key_views};
use neif::geometry::Camera;
use neif::neif::EnvironmentTransform;
use neif::render::output::turntable;
use neif::render::{CameraPath, Shot, Spin};

use super::capture::PhotoArgs;
use super::failure::{Failure, OrUnusable as _};
use super::scenes::{self, OpenRun};
use super::values;

/// Where the pictures are taken from.
#[derive(Debug, clap::Args)]
pub(crate) struct CameraFlags {
    /// From where the photos of this split were taken [default: test]
    #[arg(long, value_name = "SPLIT", conflicts_with_all = ["cameras", "turntable"])]
    split: Option<Split>,
    /// From the cameras of a transforms.json; its photos need not exist
    #[arg(long, value_name = "FILE")]
    cameras: Option<PathBuf>,
    /// From N places on a circle around the object; it begins at the first of --cameras, if given
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    turntable: Option<u32>,
    /// What turns on a turntable
    #[arg(long, value_enum, requires = "turntable", default_value = "camera")]
    spin: Spin,
    /// N pictures along a smooth path through --cameras, by their times (`time` of a frame, in seconds) if they have any
    #[arg(long, value_name = "N", requires = "cameras", conflicts_with = "turntable",
          value_parser = clap::value_parser!(u32).range(2..=100_000))]
    frames: Option<u32>,
    /// Size of the pictures [default: that of the cameras; 512x512 on a turntable without]
    #[arg(long, value_name = "WxH", value_parser = values::size)]
    size: Option<(u32, u32)>,
    /// Where the run's capture lies now
    #[arg(long, value_name = "DATASET")]
    pub(crate) dataset: Option<PathBuf>,
    /// Which way is up on a turntable: x, y, z, -x, -y, -z or X,Y,Z [default: as in the run]
    #[arg(long, value_name = "AXIS|X,Y,Z", value_parser = values::direction, allow_hyphen_values = true, requires = "turntable")]
    up: Option<Vec3>,
    #[command(flatten)]
    photos: PhotoArgs,
}

impl CameraFlags {
    /// The pictures to take of a run in an environment that stands at `transform`, and what to call a film of them.
    pub(crate) fn shots(
        &self,
        run: &OpenRun,
        transform: EnvironmentTransform,
    ) -> Result<(Vec<Shot>, &'static str), Failure> {
        if let Some(n) = self.turntable {
            return Ok((self.turntable(run, &transform, n)?, "turntable"));
        }
        if let Some(n) = self.frames {
            return Ok((self.path(transform, n)?, "path"));
        }
        let cameras = if let Some(file) = &self.cameras {
            scenes::read_cameras(file)?
        } else {
            let (views, _) = run.load_views(self.split.unwrap_or(Split::Test), &self.photos)?;
            let named = views.into_iter().map(|view| (view.name, view.camera));
            named.collect()
        };
        let shots = cameras.into_iter().map(|(name, camera)| Shot {
            name,
            camera: self.fitted(camera),
            transform,
        });
        Ok((shots.collect(), "film"))
    }

    fn turntable(
        &self,
        run: &OpenRun,
        transform: &EnvironmentTransform,
        n: u32,
    ) -> Result<Vec<Shot>, Failure> {
        let scene = &run.scene;
        let up = self.up.unwrap_or(scene.environment.up());
        let first = match &self.cameras {
            Some(file) => scenes::read_cameras(file)?.swap_remove(0).1,
            None => turntable::first_camera(scene, up),
        };
        let first = self.fitted(first);
        let center = turntable::turning_point(scene);
        let axis = (center, up);
        Ok(turntable::shots(self.spin, &first, transform, axis, n))
    }

    fn path(&self, transform: EnvironmentTransform, n: u32) -> Result<Vec<Shot>, Failure> {
        let Some(file) = &self.cameras else {
            return Err(Failure::unusable(anyhow!("--frames needs --cameras FILE")));
        };
        let keys = read_key_views(file).or_unusable()?;
        let first = self.fitted(keys[0].camera);
        let path = CameraPath::new(&keys, first.width, first.height)
            .map_err(|error| Failure::at(file, error))?;
        Ok(path.shots(&transform, n))
    }

    fn fitted(&self, camera: Camera) -> Camera {
        match self.size {
            Some((width, height)) => camera.fitted(width, height),
            None => camera,
        }
    }
}
