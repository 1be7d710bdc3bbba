//! Files of every layout, written by a few lines here, read back and compared with plain loops.

mod classic;
mod lego;
mod march;
mod nerfacto;
mod ngp;

use std::io::{Cursor, Write as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use glam::Vec3;
use zip::write::SimpleFileOptions;

use super::field::{Densities, Scratch};
use super::{Nerf, is_nerf, read};
use crate::geometry::Camera;

/// `SplitMix64`: the same numbers every time.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ self.0 >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ z >> 31
    }

    /// -1 to 1.
    fn signed(&mut self) -> f32 {
        (self.next() >> 40) as f32 / (1_u64 << 23) as f32 - 1.0
    }

    fn numbers(&mut self, n: usize, scale: f32) -> Vec<f32> {
        (0..n).map(|_| scale * self.signed()).collect()
    }

    fn point(&mut self, scale: f32) -> Vec3 {
        scale * Vec3::from_array([(); 3].map(|()| self.signed()))
    }

    fn direction(&mut self) -> Vec3 {
        self.point(1.0).normalize_or(Vec3::X)
    }
}

/// A tensor to be written.
struct TestTensor {
    name: String,
    shape: Vec<usize>,
    values: Vec<f32>,
}

fn tensor(name: &str, shape: &[usize], values: Vec<f32>) -> TestTensor {
    TestTensor {
        name: name.to_owned(),
        shape: shape.to_vec(),
        values,
    }
}

fn text(pickle: &mut Vec<u8>, text: &str) {
    pickle.push(b'X');
    pickle.extend((text.len() as u32).to_le_bytes());
    pickle.extend(text.as_bytes());
}

fn int(pickle: &mut Vec<u8>, n: usize) {
    pickle.push(b'J');
    pickle.extend((n as u32).to_le_bytes());
}

/// The pickle of `{outer: OrderedDict(tensors)}` as torch writes it.
fn pickle(outer: &str, tensors: &[TestTensor]) -> Vec<u8> {
    let mut p = b"\x80\x02}".to_vec();
    text(&mut p, outer);
    p.extend(b"ccollections\nOrderedDict\n)R(");
    for (key, tensor) in tensors.iter().enumerate() {
        text(&mut p, &tensor.name);
        p.extend(b"ctorch._utils\n_rebuild_tensor_v2\n((");
        text(&mut p, "storage");
        p.extend(b"ctorch\nFloatStorage\n");
        text(&mut p, &key.to_string());
        text(&mut p, "cpu");
        int(&mut p, tensor.values.len());
        p.extend(b"tQK\0(");
        tensor.shape.iter().for_each(|side| int(&mut p, *side));
        p.extend(b"t(");
        let strides = (0..tensor.shape.len()).map(|i| tensor.shape[i + 1..].iter().product());
        strides.for_each(|stride| int(&mut p, stride));
        p.extend(b"t\x89ccollections\nOrderedDict\n)RtR");
    }
    p.extend(b"us.");
    p
}

/// What `torch.save` writes since 1.6.
fn zip_checkpoint(outer: &str, tensors: &[TestTensor]) -> Vec<u8> {
    let mut archive = zip::ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
    let mut add = |name: &str, bytes: &[u8]| {
        archive.start_file(format!("run/{name}"), options).unwrap();
        archive.write_all(bytes).unwrap();
    };
    add("data.pkl", &pickle(outer, tensors));
    for (key, tensor) in tensors.iter().enumerate() {
        let bytes: Vec<u8> = tensor.values.iter().flat_map(|x| x.to_le_bytes()).collect();
        add(&format!("data/{key}"), &bytes);
    }
    add("version", b"3\n");
    archive.finish().unwrap().into_inner()
}

/// What it wrote before.
fn legacy_checkpoint(outer: &str, tensors: &[TestTensor]) -> Vec<u8> {
    let mut bytes =
        b"\x80\x02\x8a\x0al\xfc\x9cF\xf9 j\xa8P\x19.\x80\x02M\xe9\x03.\x80\x02}.".to_vec();
    bytes.extend(pickle(outer, tensors));
    bytes.extend(b"\x80\x02](");
    for key in 0..tensors.len() {
        text(&mut bytes, &key.to_string());
    }
    bytes.extend(b"e.");
    for tensor in tensors {
        bytes.extend((tensor.values.len() as u64).to_le_bytes());
        bytes.extend(tensor.values.iter().flat_map(|x| x.to_le_bytes()));
    }
    bytes
}

fn write(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

/// Density per unit of the scene and colour, at a point seen along a direction.
fn ask(nerf: &Nerf, point: Vec3, direction: Vec3) -> (f32, [f32; 3]) {
    let (mut scratch, mut answers) = (Scratch::default(), Densities::default());
    let point = nerf.field_from_scene.point(point);
    nerf.field.densities(&[point], &mut scratch, &mut answers);
    let direction = nerf.field_from_scene.rotation * direction;
    let mut colors = Vec::new();
    nerf.field
        .colors(&answers.features, &[direction], &mut scratch, &mut colors);
    (
        answers.densities[0] * nerf.field_from_scene.scale,
        colors[0],
    )
}

/// Fails unless a field answers as `expected` does at random points within `reach` of the origin.
#[track_caller]
fn assert_answers(nerf: &Nerf, reach: f32, expected: impl Fn(Vec3, Vec3) -> (f64, [f64; 3])) {
    let mut random = Random(99);
    let mut n_dense = 0;
    for _ in 0..50 {
        let (point, direction) = (random.point(reach), random.direction());
        let (density, color) = ask(nerf, point, direction);
        let (density_there, color_there) = expected(point, direction);
        n_dense += usize::from(density_there > 0.0);
        let tolerance = 2e-3 * (1e-3 + density_there);
        assert!(
            (f64::from(density) - density_there).abs() < tolerance,
            "{density} and not {density_there} at {point}"
        );
        for (value, value_there) in color.iter().zip(color_there) {
            let close = (f64::from(*value) - value_there).abs() < 1e-3;
            assert!(close, "{color:?} and not {color_there:?} at {point}");
        }
    }
    assert!(n_dense > 5, "something is there");
}

/// Fails where a damaged file is not answered with a field or an error that names it. Every cut and every damage is tried
/// on a file that is first read as it is.
fn assert_survives_damage(name: &str, bytes: &[u8]) {
    let folder = tempfile::tempdir().unwrap();
    let path = write(folder.path(), name, bytes);
    assert!(is_nerf(&path) && read(&path).is_ok(), "{name} is read");
    let mut random = Random(7);
    let mut n_refused = 0;
    for i in 0..260 {
        let mut damaged = bytes.to_vec();
        let at = random.next() as usize % bytes.len();
        if i < 60 {
            damaged.truncate(at);
        } else {
            // Half of them where names and sizes are.
            let at = if i % 2 == 0 {
                at
            } else {
                at % bytes.len().min(1500)
            };
            for byte in damaged.iter_mut().skip(at).take(1 + i % 4) {
                *byte = random.next() as u8;
            }
        }
        let path = write(folder.path(), "damaged", &damaged);
        match read(&path) {
            Ok(nerf) => {
                let camera = Camera::look_at(Vec3::splat(4.0), Vec3::ZERO, Vec3::Z, 0.6, 3, 3);
                // Only some: finding where a field has anything takes a while.
                if i % 64 == 0 {
                    let picture = nerf.picture(&camera, &AtomicBool::new(false)).unwrap();
                    assert!(picture.srgb.iter().flatten().all(|x| *x >= 0.0), "{i}");
                }
            }
            Err(e) => {
                n_refused += 1;
                assert!(e.to_string().contains("damaged"), "{e}");
            }
        }
    }
    assert!(n_refused >= 60, "cuts are noticed: {n_refused}");
}
