//! Finds the object in all photos.

use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::agreed::{AgreedShape, Corrected, Expected, Votes, agreement_of};
use super::found::{FoundObject, MaskError, mask_files};
use super::jobs::Jobs;
use super::learn::LearnedPlace;
use super::outline::{Photo, nothing};
use super::region::Region;
use super::seen::SeenView;
use super::selection::{Selection, Stroke};
use crate::data::{Dataset, Mask, View};
use crate::geometry::Camera;
use crate::neif::Environment;
use crate::neif::light::environment::EnvironmentField;
use crate::train::shape::stage_one::looked_at;

/// Share of the time that it takes to look at the place.
const LOOKING: f32 = 0.4;

/// Finds the selected object in the photos of a capture, on the current thread pool. `place` was learned from them with the
/// object as a part of it. `on_progress` gets 0..1.
///
/// The same input gives the same masks on any number of threads.
///
/// # Errors
/// When the environment is of another kind, when it shows nothing there, and when cancelled.
pub fn find_object(
    dataset: &Dataset,
    place: &LearnedPlace,
    (selection, strokes): (&Selection, &[Stroke]),
    cancel: &AtomicBool,
    on_progress: &(dyn Fn(f32) + Sync),
) -> Result<FoundObject, MaskError> {
    let look = |fraction| on_progress(LOOKING * fraction);
    let find = |fraction| on_progress(LOOKING + (1.0 - LOOKING) * fraction);
    let mut finder = ObjectFinder::new(dataset, place, cancel, &look)?;
    finder.find(dataset, (selection, strokes), cancel, &find)
}

/// The photos of a capture with what an environment shows of them: looked at once, and searched as often as a person points
/// somewhere else or draws a stroke.
#[derive(Debug)]
pub struct ObjectFinder {
    root: PathBuf,
    environment: Arc<Environment>,
    cameras: Vec<Camera>,
    seen: Vec<SeenView>,
    looked_at: Option<Vec3>,
    aimed: Option<Aimed>,
    /// What was aimed at before, which a stroke that is taken back brings back.
    before: Option<Aimed>,
}

/// What is known of one object before strokes say more.
#[derive(Debug)]
struct Aimed {
    selection: Selection,
    region: Region,
    /// What the place would be without it.
    empty: Environment,
    photos: Vec<Option<Photo>>,
    /// More of those that have strokes beside what was cut.
    widened: HashMap<usize, Photo>,
    /// What each was expected to show at first, with the pixels of the views as they were seen.
    priors: Vec<Mask>,
    /// What the first cut says.
    votes: Votes,
    /// The shape on which the photos agree, with the corrections so far.
    shape: AgreedShape,
}

impl ObjectFinder {
    /// Looks at the place from where the photos were taken, on the current thread pool.
    ///
    /// # Errors
    /// When the environment is of another kind, and when cancelled.
    pub fn new(
        dataset: &Dataset,
        place: &LearnedPlace,
        cancel: &AtomicBool,
        on_progress: &(dyn Fn(f32) + Sync),
    ) -> Result<Self, MaskError> {
        let environment = Arc::clone(&place.environment);
        if !matches!(environment.field(), EnvironmentField::Grid { .. }) {
            return Err(MaskError::NoSurfaces(environment.name().to_owned()));
        }
        let cameras = place.cameras_of(dataset);
        let jobs = Jobs::new(cameras.len(), cancel, on_progress);
        let see = |camera: &Camera| {
            jobs.next()?;
            Ok(SeenView::new(&environment, camera))
        };
        let seen: Vec<SeenView> = cameras.par_iter().map(see).collect::<Result<_, _>>()?;
        Ok(Self {
            root: dataset.root.clone(),
            environment,
            cameras,
            seen,
            looked_at: looked_at(dataset).map(|(center, _)| center),
            aimed: None,
            before: None,
        })
    }

    /// Finds the selected object as the strokes correct it, on the current thread pool. What an earlier call found out about the
    /// same object is not found out again.
    ///
    /// # Errors
    /// When there is nothing, and when cancelled.
    pub fn find(
        &mut self,
        dataset: &Dataset,
        (selection, strokes): (&Selection, &[Stroke]),
        cancel: &AtomicBool,
        on_progress: &(dyn Fn(f32) + Sync),
    ) -> Result<FoundObject, MaskError> {
        let views: Vec<&View> = dataset.views().collect();
        let jobs = Jobs::new(3 * views.len(), cancel, on_progress);
        let strokes: Vec<&Stroke> = strokes.iter().filter(|s| s.view < views.len()).collect();
        self.aim(&views, selection, &strokes, &jobs)?;
        let seen = &self.seen;
        let aimed = self.aimed.as_mut();
        let aimed = aimed.ok_or_else(|| MaskError::Nothing {
            dataset: self.root.clone(),
        })?;
        let agreed = (!strokes.is_empty()).then(|| aimed.votes.shape(&[]));
        let corrected = |i: usize| {
            let own = strokes_of(i, &strokes);
            let photo = aimed.photo(i, &own).filter(|_| !own.is_empty())?;
            let expected = agreed.as_ref()?.expected(&seen[i]);
            let mask = photo.cut(views[i], &expected, &own);
            Corrected::new(&seen[i], &shrunk(&mask, &seen[i]))
        };
        let corrected: Vec<Corrected<'_>> = (0..views.len())
            .into_par_iter()
            .filter_map(corrected)
            .collect();
        let shape = aimed.votes.shape(&corrected);
        let expected: Vec<Expected> = seen.par_iter().map(|view| shape.expected(view)).collect();
        let cut = |i: usize| {
            jobs.next()?;
            let strokes = strokes_of(i, &strokes);
            Ok(aimed.photo(i, &strokes).map_or_else(
                || nothing(views[i]),
                |photo| photo.cut(views[i], &expected[i], &strokes),
            ))
        };
        let masks = (0..views.len()).into_par_iter().map(cut);
        let masks: Vec<Mask> = masks.collect::<Result<_, MaskError>>()?;
        let agreement = |i: usize| agreement_of(&shrunk(&masks[i], &seen[i]), &expected[i].outline);
        let found = FoundObject {
            names: views.iter().map(|view| view.full_name()).collect(),
            files: mask_files(dataset),
            agreement: (0..views.len()).map(agreement).collect(),
            shape: shape.clone(),
            support: aimed.region.support(),
            masks,
        };
        aimed.shape = shape;
        Ok(found)
    }

    /// The mask of one photo as the strokes in it correct it, before they are heard in the others; `None` before anything was
    /// found.
    pub fn cut_one(&self, dataset: &Dataset, index: usize, strokes: &[Stroke]) -> Option<Mask> {
        let view = dataset.views().nth(index)?;
        let aimed = self.aimed.as_ref()?;
        let expected = aimed.shape.expected(&self.seen[index]);
        let strokes: Vec<&Stroke> = strokes.iter().filter(|s| s.view == index).collect();
        let photo = aimed.photo(index, &strokes)?;
        Some(photo.cut(view, &expected, &strokes))
    }

    /// Finds the part of space that the object takes up, and cuts the photos for the first time, unless that is known.
    fn aim(
        &mut self,
        views: &[&View],
        selection: &Selection,
        strokes: &[&Stroke],
        jobs: &Jobs<'_>,
    ) -> Result<(), MaskError> {
        let center = selection
            .at
            .or(selection.within.map(|within| within.center()));
        let center = center.or(self.looked_at);
        let center = center.ok_or_else(|| MaskError::NoPlace {
            dataset: self.root.clone(),
        })?;
        let region = self.region(views, selection, (center, strokes));
        let region = region.ok_or_else(|| MaskError::Nothing {
            dataset: self.root.clone(),
        })?;
        let is_known = |aimed: &Aimed| aimed.selection == *selection && aimed.region == region;
        if !self.aimed.as_ref().is_some_and(is_known) {
            std::mem::swap(&mut self.aimed, &mut self.before);
        }
        if !self.aimed.as_ref().is_some_and(is_known) {
            self.aimed = None;
            self.aimed = Some(self.aimed_at(views, *selection, region, jobs)?);
        }
        self.widen(views, strokes);
        Ok(())
    }

    /// The part of space around `center` that the object takes up.
    fn region(
        &self,
        views: &[&View],
        selection: &Selection,
        (center, strokes): (Vec3, &[&Stroke]),
    ) -> Option<Region> {
        let seen = &self.seen;
        if selection.is_masked {
            let own = |(view, seen): (&&View, &SeenView)| Some(shrunk(view.mask.as_ref()?, seen));
            let own: Vec<Option<Mask>> = views.iter().zip(seen).map(own).collect();
            return Region::of_masks(seen, center, &own);
        }
        let added = strokes.iter().filter(|stroke| stroke.adds);
        let points = added.map(|stroke| covered(stroke, views, seen));
        Region::find(seen, center, selection, &points.collect::<Vec<_>>())
    }

    /// Cuts the photos for the first time.
    fn aimed_at(
        &self,
        views: &[&View],
        selection: Selection,
        region: Region,
        jobs: &Jobs<'_>,
    ) -> Result<Aimed, MaskError> {
        let seen = &self.seen;
        // Of masks, what most of them show: single ones may be wrong altogether.
        let prior = |view: &SeenView| {
            if selection.is_masked {
                region.outline_in(view)
            } else {
                region.shown_in(view)
            }
        };
        let priors: Vec<Mask> = seen.par_iter().map(prior).collect();
        let empty = self.environment.hollowed(region.cleared(seen, &priors));
        let empty =
            empty.ok_or_else(|| MaskError::NoSurfaces(self.environment.name().to_owned()))?;
        let ready = |i: usize| {
            jobs.next()?;
            let view = (views[i], &self.cameras[i]);
            Ok(Photo::new(view, &priors[i], &[], &empty))
        };
        let photos = (0..views.len()).into_par_iter().map(ready);
        let photos: Vec<Option<Photo>> = photos.collect::<Result<_, MaskError>>()?;
        let cut = |i: usize| {
            jobs.next()?;
            let (photo, prior) = (photos[i].as_ref(), priors[i].clone());
            let mask = photo.map(|photo| photo.cut(views[i], &Expected::by(prior), &[]));
            Ok(shrunk(&mask.unwrap_or_else(|| nothing(views[i])), &seen[i]))
        };
        let masks = (0..views.len()).into_par_iter().map(cut);
        let masks = masks.collect::<Result<Vec<Mask>, MaskError>>()?;
        let votes = Votes::new(&region.around(), seen, &masks);
        Ok(Aimed {
            selection,
            region,
            empty,
            photos,
            widened: HashMap::new(),
            priors,
            shape: votes.shape(&[]),
            votes,
        })
    }

    /// Looks at more of the photos that have strokes beside the part of them that was cut.
    fn widen(&mut self, views: &[&View], strokes: &[&Stroke]) {
        let Some(aimed) = &mut self.aimed else { return };
        for (i, view) in views.iter().enumerate() {
            let own = strokes_of(i, strokes);
            let has_all = |photo: &Photo| own.iter().all(|s| photo.has_all_of(view, s));
            if !own.is_empty() && !aimed.photo(i, &own).is_some_and(has_all) {
                let view = (*view, &self.cameras[i]);
                let photo = Photo::new(view, &aimed.priors[i], &own, &aimed.empty);
                aimed.widened.extend(photo.map(|photo| (i, photo)));
            }
        }
    }
}

impl Aimed {
    /// A photo that can be cut as its strokes say.
    fn photo(&self, index: usize, strokes: &[&Stroke]) -> Option<&Photo> {
        let widened = self.widened.get(&index).filter(|_| !strokes.is_empty());
        widened.or(self.photos[index].as_ref())
    }
}

/// The strokes in one photo.
fn strokes_of<'a>(view: usize, strokes: &[&'a Stroke]) -> Vec<&'a Stroke> {
    let own = strokes.iter().filter(|stroke| stroke.view == view);
    own.copied().collect()
}

/// The surface of the place that a stroke covers, world.
fn covered(stroke: &Stroke, views: &[&View], seen: &[SeenView]) -> Vec<Vec3> {
    let view = &seen[stroke.view];
    let width = view.camera.width as usize;
    let scale = views[stroke.view].camera.width as f32 / width as f32;
    let place = |i: usize| scale * (Vec2::new((i % width) as f32, (i / width) as f32) + 0.5);
    let points = view.points.iter().enumerate();
    let points = points.filter(|(i, _)| stroke.covers(place(*i)));
    points.map(|(_, point)| *point).collect()
}

/// A photo's mask with the pixels of the view as it was seen.
fn shrunk(mask: &Mask, seen: &SeenView) -> Mask {
    let (width, height) = (seen.camera.width, seen.camera.height);
    let pixel = |i: u32| {
        let at = |v: u32, from: u32, to: u32| ((v as f32 + 0.5) * to as f32 / from as f32) as usize;
        let (x, y) = (
            at(i % width, width, mask.width),
            at(i / width, height, mask.height),
        );
        mask.coverage[y * mask.width as usize + x]
    };
    Mask {
        width,
        height,
        coverage: (0..width * height).map(pixel).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::masks::test_capture::{
        BALLS, RADII, cameras, dataset, likeness, place, true_mask,
    };

    fn find(strokes: &[Stroke]) -> FoundObject {
        let asked = (&Selection::default(), strokes);
        find_object(
            &dataset(),
            &place(),
            asked,
            &AtomicBool::new(false),
            &|_| (),
        )
        .expect("a ball")
    }

    /// A dot on the ball, as wide as `share` of it, in the first photo.
    fn dot(share: f32, adds: bool) -> Stroke {
        let camera = cameras()[0];
        let at = camera.project(BALLS[0]).expect("in front of it");
        let distance = camera.position().distance(BALLS[0]);
        Stroke {
            view: 0,
            places: vec![at],
            radius: share * RADII[0] / (distance * camera.pixel_angle()),
            adds,
        }
    }

    #[test]
    fn views_that_were_not_looked_at_get_the_outline_of_the_shape() {
        let all = dataset();
        let mut some = all.clone();
        some.train.truncate(10);
        let (asked, never) = ((&Selection::default(), &[][..]), AtomicBool::new(false));
        let found = find_object(&some, &place(), asked, &never, &|_| ()).expect("a ball");
        let completed = found.of_all_views(&all);
        assert_eq!((completed.masks.len(), completed.files.len()), (14, 14));
        assert!(completed.masks[..10] == found.masks[..]);
        let others = likeness(cameras()[10..].iter(), &completed.masks[10..], &[0]);
        assert!(others > 0.85, "{others}");
    }

    #[test]
    fn what_a_stroke_removes_is_gone_there_and_what_stands_behind_it_in_the_others_too() {
        let stroke = dot(0.5, false);
        let (before, after) = (find(&[]), find(std::slice::from_ref(&stroke)));
        let covered = |i: usize| {
            let at = Vec2::new((i % 96) as f32, (i / 96) as f32) + 0.5;
            stroke.covers(at)
        };
        let own = &after.masks[stroke.view];
        let n_left = (0..96 * 96).filter(|i| covered(*i) && own.is_object(*i));
        assert_eq!(n_left.count(), 0, "true as it is drawn");
        // The ball is a ring now, through which other photos see: those from the same side.
        let n_object = |found: &FoundObject, view: usize| {
            let mask = &found.masks[view];
            (0..96 * 96).filter(|i| mask.is_object(*i)).count()
        };
        let others = (0..14).filter(|view| *view != stroke.view);
        let n_smaller = others.filter(|v| n_object(&after, *v) < n_object(&before, *v));
        assert!(n_smaller.count() > 0);
    }

    #[test]
    fn masks_that_are_shifted_are_refined_and_missing_ones_made() {
        let mut dataset = dataset();
        for (i, view) in dataset.train.iter_mut().enumerate().skip(1) {
            let mut mask = true_mask(&view.camera, &[0, 1]);
            // Two pixels to the left or to the right.
            mask.coverage
                .rotate_left(if i % 2 == 0 { 2 } else { 96 * 96 - 2 });
            view.mask = Some(mask);
        }
        let given: Vec<Mask> = dataset
            .views()
            .skip(1)
            .filter_map(|v| v.mask.clone())
            .collect();
        let before = likeness(cameras()[1..].iter(), &given, &[0, 1]);
        let selection = Selection {
            is_masked: true,
            ..Selection::default()
        };
        let never = AtomicBool::new(false);
        let found = find_object(&dataset, &place(), (&selection, &[]), &never, &|_| ());
        let found = found.expect("the balls");
        let after = likeness(cameras()[1..].iter(), &found.masks[1..], &[0, 1]);
        assert!(after > 0.95 && after > before + 0.05, "{before} -> {after}");
        let made = likeness(cameras()[..1].iter(), &found.masks[..1], &[0, 1]);
        assert!(made > 0.9, "{made}");
    }

    #[test]
    fn what_is_known_of_an_object_is_not_found_out_again_and_strokes_can_be_taken_back() {
        let (dataset, never) = (dataset(), AtomicBool::new(false));
        let mut finder = ObjectFinder::new(&dataset, &place(), &never, &|_| ()).expect("a grid");
        assert!(
            finder.cut_one(&dataset, 0, &[]).is_none(),
            "nothing is found"
        );
        let asked = Selection::default();
        let mut find = |strokes: &[Stroke]| {
            let found = finder.find(&dataset, (&asked, strokes), &never, &|_| ());
            found.expect("a ball").masks
        };
        let first = find(&[]);
        let corner = Stroke {
            view: 2,
            places: vec![Vec2::splat(2.0)],
            radius: 2.0,
            adds: true,
        };
        let drawn = find(std::slice::from_ref(&corner));
        assert!(drawn[2].is_object(0), "far beside what was cut before");
        assert!(find(&[]) == first, "taken back");
        let alone = finder.cut_one(&dataset, 2, &[corner]).expect("it is found");
        assert!(alone.is_object(0));
        let cancelled = AtomicBool::new(true);
        let asked = Selection {
            at: Some(BALLS[1]),
            ..Selection::default()
        };
        let found = finder.find(&dataset, (&asked, &[]), &cancelled, &|_| ());
        assert!(matches!(found, Err(MaskError::Cancelled)));
    }
}
