//! The bundled demo capture loads whole and clean.

use std::path::Path;

use neif::data::{Dataset, LoadOptions, check};

#[test]
fn the_bundled_demo_loads_without_problems() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/demo");
    let dataset = Dataset::load(&root, &LoadOptions::default()).unwrap();
    let report = check(&dataset);
    assert!(report.problems.is_empty(), "{report}");
    let n_views = (dataset.train.len(), dataset.val.len(), dataset.test.len());
    assert_eq!(n_views, (48, 6, 6), "views");
    assert!(dataset.views().all(|view| view.mask.is_some()), "masks");
    let agreement = report.agreement.unwrap();
    assert!(agreement.worst_iou > 0.98, "mesh and masks: {agreement:?}");
}
