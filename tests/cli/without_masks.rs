//! A capture without masks: the bundled one, without what says where the object is.

use std::fs;
use std::path::Path;

use serde_json::Value;

/// The bundled capture.
pub(crate) fn demo() -> String {
    format!("{}/assets/demo", env!("CARGO_MANIFEST_DIR"))
}

/// The bundled capture without anything that says where the object is; every so many photos of it.
pub(crate) fn write_without_masks(folder: &Path, stride: usize) {
    for split in ["train", "val", "test"] {
        fs::create_dir_all(folder.join(split)).expect("a folder");
        let list = format!("transforms_{split}.json");
        let text = fs::read(Path::new(&demo()).join(&list)).expect("a list of photos");
        let mut json: Value = serde_json::from_slice(&text).expect("JSON");
        let frames = json["frames"].as_array_mut().expect("frames");
        let mut number = 0..;
        frames.retain(|_| {
            number
                .next()
                .is_some_and(|i: usize| i.is_multiple_of(stride))
        });
        for frame in frames {
            frame.as_object_mut().expect("a frame").remove("mask_path");
            let file = frame["file_path"].as_str().expect("a path").to_owned();
            fs::copy(Path::new(&demo()).join(&file), folder.join(&file)).expect("a photo");
        }
        fs::write(folder.join(list), json.to_string()).expect("a list of photos");
    }
}
