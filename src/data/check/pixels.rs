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
    problems.extend(flat_photos(dataset));
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
    use Severity::{Error, Note, Warning};

    let without = names(dataset, |view| view.mask.is_none());
    if without.len() == dataset.views().count() {
        let advice = if dataset.mesh.is_some() {
            "the mesh's silhouette is used"
        } else {
            "the environment alone is trained; `--object auto` of `neif train` and Select the object in the window cut out what \
             the cameras look at, `neif masks` writes its masks"
        };
        problems.push(Problem::new(Note, "no view has a mask", advice));
    } else {
        problems.extend(of_views(Warning, &without, "without a mask", ""));
        if dataset.mesh.is_none() {
            let what = "the views have masks, but there is no mesh of the object";
            let advice = "training makes one from the masks first; name your own with --mesh";
            problems.push(Problem::new(Note, what, advice));
        }
    }
    let mut add = |severity, is_so: &dyn Fn(&Mask) -> bool, what: &str, advice: &str| {
        let names = names(dataset, |view| view.mask.as_ref().is_some_and(is_so));
        problems.extend(of_views(severity, &names, what, advice));
    };
    let is_black = |mask: &Mask| mask.mean() == 0.0;
    let advice = "no object is seen there; check the mask files";
    add(Error, &is_black, "with an all-black mask", advice);
    let is_tiny = |mask: &Mask| mask.mean() > 0.0 && mask.mean() < MIN_COVERAGE;
    let advice = "the object covers a few pixels only";
    add(Warning, &is_tiny, "with a nearly empty mask", advice);
    let is_white = |mask: &Mask| mask.coverage.iter().all(|c| *c == 255);
    let advice = "no background is seen there; check the mask files";
    add(Warning, &is_white, "with an all-white mask", advice);
}

fn flat_photos(dataset: &Dataset) -> Option<Problem> {
    let flat = names(dataset, |view| {
        let first = view.photo.srgb(0);
        (1..view.photo.n_pixels()).all(|i| view.photo.srgb(i) == first)
    });
    let advice = "they show nothing; check the files";
    of_views(Severity::Warning, &flat, "of one colour all over", advice)
}

/// The same pixels, or the same pose, twice.
fn find_copies(dataset: &Dataset, problems: &mut Vec<Problem>) {
    let mut prints: Vec<(u64, &View)> = dataset
        .views()
        .map(|view| (fingerprint(view), view))
        .collect();
    // The stable sort keeps training before test.
    prints.sort_by_key(|(print, _)| *print);
    let (mut leaks, mut copies, mut moved) = (Vec::new(), Vec::new(), Vec::new());
    for same in prints.chunk_by(|a, b| a.0 == b.0) {
        for pair in same.windows(2) {
            let (first, second) = (pair[0].1, pair[1].1);
            let lists = if first.split != second.split {
                &mut leaks
            } else if first.camera.world_from_camera == second.camera.world_from_camera {
                &mut copies
            } else {
                &mut moved
            };
            lists.push(format!("{} = {}", label(first), label(second)));
        }
    }
    let what = "with a photo that another split has too";
    let advice = "the measure on these views means nothing";
    problems.extend(of_views(Severity::Warning, &leaks, what, advice));
    problems.extend(of_views(Severity::Warning, &copies, "listed twice", ""));
    let what = "with another view's photo but another pose";
    let advice = "one of the poses must be wrong";
    problems.extend(of_views(Severity::Error, &moved, what, advice));
}

/// A view's name with its split's.
fn label(view: &View) -> String {
    format!("{}/{}", view.split, view.name)
}

fn names(dataset: &Dataset, is_so: impl Fn(&View) -> bool) -> Vec<String> {
    let views = dataset.views().filter(|view| is_so(view));
    views.map(label).collect()
}

fn of_views(severity: Severity, names: &[String], what: &str, advice: &str) -> Option<Problem> {
    let what = format!("{} views {what}: {}", names.len(), first_names(names));
    (!names.is_empty()).then(|| Problem::new(severity, what, advice))
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
