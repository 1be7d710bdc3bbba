//! Tests of `folder`.

use glam::Vec3;

use super::*;
use crate::neif::light::environment::EnvironmentKind;
use crate::render::library::sky;
use crate::render::test_scene::environment;

/// A library that is not there yet, beside a bundled `gallery`.
fn library() -> (tempfile::TempDir, Library) {
    let root = tempfile::tempdir().unwrap();
    let bundled = root.path().join("bundled");
    fs::create_dir(&bundled).unwrap();
    let gallery = light_in(&bundled, "gallery");
    environment(5).save(&gallery, Storage::F16).unwrap();
    fs::write(bundled.join("README.md"), "no environment").unwrap();
    let folder = root.path().join("deep/library");
    (root, Library::new(Some(folder), Some(bundled)))
}

fn called(name: &str) -> Record {
    Record {
        name: Some(name.to_owned()),
        ..Record::default()
    }
}

fn names(library: &Library) -> Vec<String> {
    let entries = library.entries().unwrap().into_iter();
    entries.map(|entry| entry.name).collect()
}

fn n_files(library: &Library) -> usize {
    fs::read_dir(library.folder().unwrap()).unwrap().count()
}

#[test]
fn what_is_added_is_listed_after_the_bundled_ones_with_all_that_is_known() {
    let (_root, library) = library();
    assert_eq!(names(&library), ["gallery"], "no folder yet");
    let record = Record {
        origin: Some("https://example.org/sky.hdr".to_owned()),
        licence: Some("CC0".to_owned()),
        ..called("Evening sky")
    };
    let light = Arc::new(sky([2.0, 1.0, 0.5], Vec3::Y));
    let added = library.add(&light, Storage::F32, record.clone()).unwrap();
    library
        .add(&environment(3), Storage::F16, called("attic"))
        .unwrap();
    assert_eq!(names(&library), ["gallery", "attic", "Evening sky"]);
    assert_eq!(n_files(&library), 6, "three files each");

    let found = library.find("Evening sky").unwrap();
    assert_eq!(found, added);
    assert_eq!(found.record.licence, record.licence);
    assert_eq!(
        found.about(),
        "From https://example.org/sky.hdr\nLicence: CC0"
    );
    assert_eq!(found.kind().unwrap(), EnvironmentKind::Panorama);
    assert!(
        Environment::load(&found.file)
            .unwrap()
            .is_same_light(&light)
    );
    let picture = library.picture(&found.file).expect("a picture");
    let size = image::image_dimensions(picture).unwrap();
    assert_eq!(size, (176, 88));

    let gallery = library.find("gallery").unwrap();
    assert!(gallery.is_bundled && gallery.record == Record::default());
    assert_eq!(gallery.kind().unwrap(), EnvironmentKind::Trained);
    assert_eq!(library.picture(&gallery.file), None);
}

#[test]
fn a_second_one_of_a_name_gets_a_number_and_overwrites_nothing() {
    let (_root, library) = library();
    let light = Arc::new(sky([1.0; 3], Vec3::Z));
    let add = |name: &str| {
        let added = library.add(&light, Storage::F32, called(name)).unwrap();
        let stem = added.file.file_stem().unwrap().to_str().unwrap().to_owned();
        (added.name, stem)
    };
    let pair = |name: &str, stem: &str| (name.to_owned(), stem.to_owned());
    assert_eq!(add("a/b"), pair("a/b", "a_b"));
    assert_eq!(add("a:b"), pair("a:b 2", "a_b 2"), "the same file's name");
    assert_eq!(
        add("A/B"),
        pair("A/B 3", "A_B 3"),
        "some systems have no case"
    );
    assert_eq!(
        add("gallery"),
        pair("gallery 2", "gallery 2"),
        "a bundled one"
    );
    assert_eq!(add(" "), pair("environment", "environment"));
    let long = "x".repeat(300);
    assert_ne!(add(&long).1, add(&long).1);
    assert_eq!(
        library.find("a:b 2").unwrap(),
        library.find("a_b 2").unwrap()
    );
    let unnamed = library.add(&light, Storage::F32, Record::default());
    assert_eq!(unnamed.unwrap().name, "sky", "as it calls itself");
}

#[test]
fn a_copied_file_keeps_its_bytes() {
    let (root, library) = library();
    let file = root.path().join("half.safetensors");
    environment(8).save(&file, Storage::F16).unwrap();
    let added = library.add_file(&file, &environment(8), called("half"));
    let added = added.unwrap().file;
    assert_eq!(fs::read(added).unwrap(), fs::read(&file).unwrap());
    let missing = root.path().join("missing.safetensors");
    let refused = library.add_file(&missing, &environment(8), called("missing"));
    assert!(
        refused
            .unwrap_err()
            .to_string()
            .contains("missing.safetensors")
    );
    assert_eq!(n_files(&library), 3, "nothing is left of what failed");
}

#[test]
fn a_person_s_own_are_removed_whole_and_bundled_ones_stay() {
    let (_root, library) = library();
    let light = Arc::new(sky([1.0; 3], Vec3::Z));
    let entry = library
        .add(&light, Storage::F32, called("sky 1.5"))
        .unwrap();
    library.add(&light, Storage::F32, called("sky 1")).unwrap();
    // Without picture and record it is an environment all the same.
    fs::remove_file(picture_of(&entry.file)).unwrap();
    assert_eq!(library.remove("sky 1.5").unwrap().file, entry.file);
    assert_eq!(names(&library), ["gallery", "sky 1"]);
    assert_eq!(n_files(&library), 3);

    let bundled = library.remove("gallery").unwrap_err();
    assert!(bundled.is_of_request(), "{bundled}");
    let unknown = library.remove("galery").unwrap_err();
    assert!(unknown.is_of_request(), "{unknown}");
    let unknown = unknown.to_string();
    assert!(
        unknown.contains("`galery`") && unknown.contains("gallery, sky 1"),
        "{unknown}"
    );
    assert_eq!(names(&library), ["gallery", "sky 1"]);
}

#[test]
fn what_a_person_puts_there_is_listed_and_what_is_wrong_with_it_said() {
    let (_root, library) = library();
    let folder = library.made_folder().unwrap();
    environment(2)
        .save(&light_in(folder, "plain"), Storage::F32)
        .unwrap();
    fs::write(light_in(folder, "garbage"), "no tensors").unwrap();
    fs::write(folder.join("garbage.toml"), "license = 1").unwrap();
    fs::write(folder.join("notes.txt"), "no environment").unwrap();
    assert_eq!(names(&library), ["gallery", "garbage", "plain"]);
    assert_eq!(library.find("plain").unwrap().problem, None);
    let garbage = library.find("garbage").unwrap();
    assert!(
        garbage
            .problem
            .as_ref()
            .is_some_and(|what| what.contains("license")),
        "{garbage:?}"
    );
    assert!(garbage.kind().is_err());
}

#[test]
fn a_picture_older_than_its_light_is_not_shown() {
    let (_root, library) = library();
    let light = Arc::new(sky([1.0; 3], Vec3::Z));
    let entry = library.add(&light, Storage::F32, called("sky")).unwrap();
    let later = std::time::SystemTime::now() + std::time::Duration::from_secs(10);
    let file = File::options().append(true).open(&entry.file).unwrap();
    file.set_modified(later).unwrap();
    assert_eq!(library.picture(&entry.file), None);
}

#[test]
fn without_a_folder_the_bundled_ones_are_there_and_none_can_be_added() {
    let (_root, library) = library();
    let library = Library::new(None, library.bundled);
    assert_eq!(names(&library), ["gallery"]);
    let refused = library.add(&environment(1), Storage::F32, Record::default());
    assert!(matches!(refused, Err(LibraryError::NoFolder)));
}
