//! Faults in photos, masks and poses that show without a mesh.

use std::hash::{DefaultHasher, Hash as _, Hasher as _};

use crate::data::problem::first_names;
use crate::data::{Dataset, Mask, Problem, Severity, View};

/// A mask with less object than this share is as good as empty.
const MIN_COVERAGE: f32 = 5e-4;
/// Fewer training views than this leave much of an object unseen.
const FEW_VIEWS: usize = 10;

/// Looks through all views.
pub(super) fn find_problems(dataset: &Dataset) -> Vec<Problem> {
    let mut problems = Vec::new();
    find_mask_faults(dataset, &mut problems);
    find_flat_photos(dataset, &mut problems);
    find_copies(dataset, &mut problems);
    let n_train = dataset.train.len();
    if n_train > 0 && n_train < FEW_VIEWS {
        let what = format!("only {n_train} training views");
        let advice = "expect holes where no photo looks; 40 or more are customary";
        problems.push(Problem::new(Severity::Warning, what, advice));
    }
    problems
}

fn find_mask_faults(dataset: &Dataset, problems: &mut Vec<Problem>) {
    let n_views = dataset.views().count();
    let views_whose_mask = |is_so: &dyn Fn(&Mask) -> bool| {
        names(dataset, |view| view.mask.as_ref().is_some_and(is_so))
    };
    let without = names(dataset, |view| view.mask.is_none());
    if without.len() == n_views {
        let advice = if dataset.mesh.is_some() {
            "the mesh's silhouette is used"
        } else if dataset.origin.points.is_some() {
            "without masks and mesh the object cannot be distinguished from the background; `neif mesh` makes a coarse mesh \
             of the points around the place that the cameras look at"
        } else {
            "without masks and mesh the object cannot be distinguished from the background"
        };
        problems.push(Problem::new(Severity::Note, "no view has a mask", advice));
    } else {
        add(problems, Severity::Warning, &without, "without a mask", "");
        if dataset.mesh.is_none() {
            let what = "the views have masks, but there is no mesh of the object";
            let advice = "training makes one from the masks first; name your own with --mesh";
            problems.push(Problem::new(Severity::Note, what, advice));
        }
    }
    let black = views_whose_mask(&|mask| mask.mean() == 0.0);
    let advice = "no object is seen there; check the mask files";
    add(
        problems,
        Severity::Error,
        &black,
        "with an all-black mask",
        advice,
    );
    let tiny = views_whose_mask(&|mask| mask.mean() > 0.0 && mask.mean() < MIN_COVERAGE);
    let advice = "the object covers a few pixels only";
    add(
        problems,
        Severity::Warning,
        &tiny,
        "with a nearly empty mask",
        advice,
    );
    let white = views_whose_mask(&|mask| mask.coverage.iter().all(|c| *c == 255));
    let advice = "no background is seen there; check the mask files";
    add(
        problems,
        Severity::Warning,
        &white,
        "with an all-white mask",
        advice,
    );
}

fn find_flat_photos(dataset: &Dataset, problems: &mut Vec<Problem>) {
    let flat = names(dataset, |view| {
        let first = view.photo.srgb(0);
        (1..view.photo.n_pixels()).all(|i| view.photo.srgb(i) == first)
    });
    let advice = "they show nothing; check the files";
    add(
        problems,
        Severity::Warning,
        &flat,
        "of one colour all over",
        advice,
    );
}

/// The same pixels, or the same pose, twice.
fn find_copies(dataset: &Dataset, problems: &mut Vec<Problem>) {
    let mut prints: Vec<(u64, Labelled<'_>)> = labelled(dataset)
        .map(|view| (fingerprint(view.view), view))
        .collect();
    // The stable sort keeps training before test.
    prints.sort_by_key(|(print, _)| *print);
    let (mut leaks, mut copies, mut moved) = (Vec::new(), Vec::new(), Vec::new());
    for pair in prints.windows(2) {
        let [(a, first), (b, second)] = pair else {
            continue;
        };
        if a != b {
            continue;
        }
        let label = format!("{} = {}", first.label(), second.label());
        let same_pose = first.view.camera.world_from_camera == second.view.camera.world_from_camera;
        let lists = if first.split != second.split {
            &mut leaks
        } else if same_pose {
            &mut copies
        } else {
            &mut moved
        };
        lists.push(label);
    }
    let advice = "the measure on these views means nothing";
    add(
        problems,
        Severity::Warning,
        &leaks,
        "with a photo that another split has too",
        advice,
    );
    add(problems, Severity::Warning, &copies, "listed twice", "");
    let advice = "one of the poses must be wrong";
    add(
        problems,
        Severity::Error,
        &moved,
        "with another view's photo but another pose",
        advice,
    );
}

/// A view with its split's name.
struct Labelled<'a> {
    split: &'static str,
    view: &'a View,
}

impl Labelled<'_> {
    fn label(&self) -> String {
        format!("{}/{}", self.split, self.view.name)
    }
}

fn labelled(dataset: &Dataset) -> impl Iterator<Item = Labelled<'_>> {
    let train = dataset.train.iter().map(|view| ("train", view));
    let val = dataset.val.iter().map(|view| ("val", view));
    let test = dataset.test.iter().map(|view| ("test", view));
    train
        .chain(val)
        .chain(test)
        .map(|(split, view)| Labelled { split, view })
}

fn names(dataset: &Dataset, is_so: impl Fn(&View) -> bool) -> Vec<String> {
    labelled(dataset)
        .filter(|labelled| is_so(labelled.view))
        .map(|labelled| labelled.label())
        .collect()
}

fn add(
    problems: &mut Vec<Problem>,
    severity: Severity,
    names: &[String],
    what: &str,
    advice: &str,
) {
    if !names.is_empty() {
        let what = format!("{} views {what}: {}", names.len(), first_names(names));
        problems.push(Problem::new(severity, what, advice));
    }
}

/// A hash of the pixels; photos of one colour get their own, they are reported elsewhere.
fn fingerprint(view: &View) -> u64 {
    let mut hasher = DefaultHasher::new();
    let first = view.photo.srgb(0);
    let mut flat = true;
    for i in 0..view.photo.n_pixels() {
        let color = view.photo.srgb(i);
        flat &= color == first;
        color.map(f32::to_bits).hash(&mut hasher);
    }
    if flat {
        std::ptr::from_ref(view).hash(&mut hasher);
    }
    hasher.finish()
}
