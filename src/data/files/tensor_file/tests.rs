//! Tests of `tensor_file`.

use super::*;
use crate::data::test_asserts::assert_error;

fn sample() -> TensorFile {
    let mut file = TensorFile::default();
    file.insert_f32(
        "grid/level_0",
        &[2, 3],
        vec![1.0, -0.0, 3.5, f32::MIN_POSITIVE, 1e30, 6.0],
    );
    file.insert_u16("half", &[3], vec![1, 2, 65535]);
    file.insert_u64("rng", &[2], vec![u64::MAX, 7]);
    file.insert_f32("empty", &[0, 4], Vec::new());
    file.metadata.insert("format".to_owned(), "1".to_owned());
    file.metadata
        .insert("zeta".to_owned(), "\"quoted\"".to_owned());
    file
}

#[test]
fn what_is_written_is_read_back_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.safetensors");
    let file = sample();
    file.write(&path).unwrap();
    let read = TensorFile::read(&path).unwrap();
    assert_eq!(read.tensors, file.tensors, "arrays survive");
    assert_eq!(read.metadata, file.metadata, "metadata survives");
    assert_eq!(
        read.to_bytes(),
        file.to_bytes(),
        "equal contents, equal bytes"
    );
}

#[test]
fn every_truncation_is_an_error_and_not_a_panic() {
    let bytes = sample().to_bytes();
    for length in 0..bytes.len() {
        let result = TensorFile::from_bytes(&bytes[..length], Path::new("cut.safetensors"));
        assert_error(result, &["cut.safetensors"]);
    }
}

#[test]
fn text_entries_are_read_without_the_arrays() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.safetensors");
    let bytes = sample().to_bytes();
    let header = 8 + u64::from_le_bytes(*bytes.first_chunk().unwrap()) as usize;
    std::fs::write(&path, &bytes[..header]).unwrap();
    let read = TensorFile::read_metadata(&path).unwrap();
    assert_eq!(read.metadata, sample().metadata);
    assert!(read.tensors.is_empty());
    for length in 0..header {
        std::fs::write(&path, &bytes[..length]).unwrap();
        assert_error(
            TensorFile::read_metadata(&path),
            &["a.safetensors", "valid"],
        );
    }
    std::fs::write(&path, [0xff; 64]).unwrap();
    assert_error(TensorFile::read_metadata(&path), &["header is too long"]);
    let missing = folder.path().join("missing");
    assert_error(TensorFile::read_metadata(&missing), &["missing"]);
}

#[test]
fn wrong_shape_type_or_name_is_reported_with_file_and_tensor() {
    let file =
        TensorFile::from_bytes(&sample().to_bytes(), Path::new("run/x.safetensors")).unwrap();
    let shape = file.f32("grid/level_0", &[3, 2]).unwrap_err().to_string();
    assert_eq!(
        shape,
        "run/x.safetensors: tensor `grid/level_0` is F32 [2, 3], expected F32 [3, 2]"
    );
    let dtype = file.u64("half", &[3]);
    assert_error(dtype, &["`half` is U16 [3], expected U64 [3]"]);
    let missing = file.f32("nothing", &[1]).unwrap_err().to_string();
    assert_eq!(missing, "run/x.safetensors: tensor `nothing` is missing");
}

#[test]
fn a_failed_write_leaves_the_old_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("taken");
    std::fs::create_dir(&path).unwrap();
    std::fs::write(path.join("inside"), b"old").unwrap();
    assert!(
        sample().write(&path).is_err(),
        "a folder cannot be replaced by a file"
    );
    assert_eq!(std::fs::read(path.join("inside")).unwrap(), b"old");
    let left = std::fs::read_dir(folder.path()).unwrap().count();
    assert_eq!(left, 1, "no temporary file is left behind");
}

#[test]
#[should_panic(expected = "does not fit")]
fn a_shape_that_does_not_fit_is_a_bug() {
    TensorFile::default().insert_f32("x", &[2, 2], vec![0.0; 3]);
}
