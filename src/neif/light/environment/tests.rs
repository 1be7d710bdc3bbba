//! Tests of `environment`.

use std::path::PathBuf;

use super::*;
use crate::neif::networks::hash_grid::GridConfig;
use crate::neif::storage::KIND;

fn environment() -> Environment {
    let config = FieldConfig {
        grid: GridConfig::SMALL,
        n_hidden: 16,
        view_dependent: true,
        integrated: true,
        is_far: false,
    };
    let field = RadianceField::new(config, || 0.3);
    Environment::new(place(), field, DensityGrid::default())
}

fn place() -> EnvironmentPlace {
    let frame = FieldFrame {
        center: Vec3::new(1.0, 2.0, 3.0),
        half_side: 4.0,
    };
    EnvironmentPlace {
        name: "room".to_owned(),
        frame,
        gamma: 1.0,
        n_samples: 16,
        up: Vec3::Z,
    }
}

/// A folder with the environment's file, and the path of that.
fn saved(environment: &Environment, storage: Storage) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("environment.safetensors");
    environment.save(&path, storage).unwrap();
    (folder, path)
}

fn refusal(path: &Path) -> String {
    Environment::load(path).unwrap_err().to_string()
}

#[test]
fn a_saved_environment_comes_back_the_same() {
    let (_folder, path) = saved(&environment(), Storage::F32);
    let back = Environment::load(&path).unwrap();
    assert_eq!(back.place, environment().place);
    assert_eq!(back.params(), environment().params());
    assert_eq!(back.floor(), None);
}

#[test]
fn a_saved_environment_keeps_its_floor() {
    let mut over_a_floor = environment();
    let laid = Floor::new(Vec3::new(0.0, 0.0, -0.3), Vec3::Z);
    match &mut over_a_floor.field {
        EnvironmentField::Grid { density, .. } => density.floor = Some(laid),
        _ => panic!("a grid"),
    }
    let (_folder, path) = saved(&over_a_floor, Storage::F16);
    assert_eq!(Environment::load(&path).unwrap().floor(), Some(laid));
    let mut file = TensorFile::read(&path).unwrap();
    file.insert_f32("floor", &[4], vec![0.0; 4]);
    file.write(&path).unwrap();
    let error = refusal(&path);
    assert!(error.contains("floor"), "{error}");
}

#[test]
fn a_saved_environment_keeps_how_bright_its_lamps_are() {
    let gains = vec![(Vec3::X, Vec3::new(4.0, 2.0, 0.5)), (Vec3::Z, Vec3::ONE)];
    let lit = environment().with_lamps(EstimatedLamps::new(gains));
    let (_folder, path) = saved(&lit, Storage::F16);
    let back = Environment::load(&path).unwrap();
    assert_eq!(back.estimated_lamps(), lit.estimated_lamps());
    let lamps = back.estimated_lamps().unwrap();
    let near_x = Vec3::new(0.9, 0.3, 0.1).normalize_or_zero();
    assert_eq!(lamps.gain(near_x), Vec3::new(4.0, 2.0, 0.5));
    assert!(lit.hollowed(|_| false).unwrap().estimated_lamps().is_some());
    let array = |values: &[f32]| (vec![values.len() / 3, 3], values.to_vec());
    for (name, (shape, values)) in [
        ("lamps.gains", array(&[1.0; 3])),
        ("lamps.gains", array(&[1.0, 1.0, 1.0, 1.0, -1.0, 1.0])),
        ("lamps.gains", array(&[f32::NAN; 6])),
        ("lamps.directions", array(&[1.0, 0.0, 0.0, 0.0, 3.0, 0.0])),
        ("lamps.directions", (vec![6], vec![1.0; 6])),
    ] {
        let mut file = TensorFile::read(&path).unwrap();
        file.insert_f32(name, &shape, values);
        let folder = tempfile::tempdir().unwrap();
        let bad = folder.path().join("bad.safetensors");
        file.write(&bad).unwrap();
        let error = refusal(&bad);
        let names_it = error.contains("lamps.") && error.contains("bad.safetensors");
        assert!(names_it, "{error}");
    }
}

#[test]
fn half_precision_makes_a_smaller_file_of_nearly_the_same_field() {
    let (_folder, single) = saved(&environment(), Storage::F32);
    let (_folder, half) = saved(&environment(), Storage::F16);
    let size = |path: &Path| std::fs::metadata(path).unwrap().len();
    assert!(size(&half) < size(&single), "{}", size(&half));
    let back = Environment::load(&half).unwrap();
    assert_eq!(back.params().len(), environment().params().len());
    for (a, b) in back.params().iter().zip(environment().params()) {
        assert!((a - b).abs() <= 1e-3 * b.abs(), "{a}, not {b}");
    }
}

#[test]
fn the_paper_s_field_comes_back_as_one() {
    let config = PaperFieldConfig {
        depth: 2,
        width: 16,
        ..PaperFieldConfig::default()
    };
    let paper = Environment::of_paper(place(), PaperField::new(config, || 0.3));
    let (_folder, path) = saved(&paper, Storage::F32);
    let back = Environment::load(&path).unwrap();
    assert!(matches!(back.field, EnvironmentField::Paper(_)), "the kind");
    assert_eq!(back.params(), paper.params());
}

#[test]
fn the_kind_is_known_from_the_beginning_of_a_file() {
    let (_folder, path) = saved(&environment(), Storage::F16);
    let kind = |path: &Path| EnvironmentKind::of_file(path).unwrap();
    assert_eq!(kind(&path), EnvironmentKind::Trained);
    let config = PaperFieldConfig {
        depth: 2,
        width: 16,
        ..PaperFieldConfig::default()
    };
    let paper = Environment::of_paper(place(), PaperField::new(config, || 0.3));
    paper.save(&path, Storage::F32).unwrap();
    assert_eq!(kind(&path).to_string(), "paper network");
    let mut file = TensorFile::read(&path).unwrap();
    for (key, value) in [(KIND, "splats"), ("format", "neif-object-1")] {
        file.metadata.insert(key.to_owned(), value.to_owned());
        file.write(&path).unwrap();
        let error = EnvironmentKind::of_file(&path).unwrap_err().to_string();
        assert!(error.contains(key), "{error}");
    }
}

#[test]
fn a_file_without_a_kind_holds_a_grid_and_an_unknown_kind_is_refused() {
    let (_folder, path) = saved(&environment(), Storage::F32);
    let mut file = TensorFile::read(&path).unwrap();
    file.metadata.remove(KIND);
    file.write(&path).unwrap();
    let old = Environment::load(&path).unwrap();
    assert_eq!(old.params(), environment().params());
    file.metadata.insert(KIND.to_owned(), "splats".to_owned());
    file.write(&path).unwrap();
    let error = refusal(&path);
    assert!(error.contains("splats"), "{error}");
    file.metadata.remove(KIND);
    let header = file.metadata.get_mut("environment").unwrap();
    *header = header.replace("gamma", "gama");
    file.write(&path).unwrap();
    let error = refusal(&path);
    assert!(error.contains("gam"), "{error}");
    let header = file.metadata.get_mut("environment").unwrap();
    *header = header
        .replace("gama", "gamma")
        .replacen('{', "{\"dusk\":1,", 1);
    file.write(&path).unwrap();
    let error = refusal(&path);
    assert!(error.contains("dusk"), "{error}");
}

#[test]
fn damaged_files_are_refused_by_name() {
    let (_folder, path) = saved(&environment(), Storage::F32);
    let bytes = std::fs::read(&path).unwrap();
    for length in [0, 5, 100, bytes.len() / 2, bytes.len() - 1] {
        std::fs::write(&path, &bytes[..length]).unwrap();
        let error = refusal(&path);
        assert!(error.contains("environment.safetensors"), "{error}");
    }
    let mut broken = environment();
    let EnvironmentField::Grid { field, .. } = &mut broken.field else {
        panic!("a grid");
    };
    field.params[7] = f32::NAN;
    broken.save(&path, Storage::F32).unwrap();
    let error = refusal(&path);
    assert!(error.contains("field.params"), "{error}");
}
