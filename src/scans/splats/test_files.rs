//! What the tests of the formats share: random Gaussians, a colour by the definition of the harmonics, damaged files.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use glam::{Quat, Vec3};

use super::{Splat, Splats, is_splats, read};

/// Damages of each file.
const N_SEEDS: u64 = 200;
/// Most memory that the process may ever have, kilobytes.
const MAX_KB: u64 = 3 << 20;

/// `SplitMix64`: the same numbers every time.
pub(super) struct Random(pub(super) u64);

impl Random {
    pub(super) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Below `n`, which must not be zero.
    pub(super) fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }

    /// From -1 to 1.
    pub(super) fn signed(&mut self) -> f32 {
        (self.next() >> 40) as f32 / (1 << 23) as f32 - 1.0
    }

    pub(super) fn vector(&mut self) -> Vec3 {
        Vec3::from_array([(); 3].map(|()| self.signed()))
    }
}

/// Gaussians within [-4, 4]³, with opacities, scales, colours and harmonics that every format can hold.
pub(super) fn random_splats(n: usize, degree: usize) -> Splats {
    let mut random = Random(7);
    let mut splats = Splats {
        degree,
        ..Splats::default()
    };
    for _ in 0..n {
        let [x, y, z, w] = [(); 4].map(|()| random.signed());
        splats.splats.push(Splat {
            center: random.vector() * 4.0,
            scale: (random.vector() * 2.0 - 3.0).exp(),
            rotation: Quat::from_xyzw(x, y, z, w).normalize(),
            opacity: 0.5 + 0.45 * random.signed(),
        });
        let harmonics = (0..(degree + 1).pow(2)).map(|_| (random.vector() * 0.9).to_array());
        splats.harmonics.extend(harmonics);
    }
    splats
}

/// The harmonics up to the third degree in a direction, by degree and order, with the phase (-1)^m of the reference.
fn basis(d: Vec3) -> [f32; 16] {
    let Vec3 { x, y, z } = d;
    let pi = std::f32::consts::PI;
    let c = |numerator: f32, divisor: f32| (numerator / (divisor * pi)).sqrt();
    [
        c(1.0, 4.0),
        -c(3.0, 4.0) * y,
        c(3.0, 4.0) * z,
        -c(3.0, 4.0) * x,
        c(15.0, 4.0) * x * y,
        -c(15.0, 4.0) * y * z,
        c(5.0, 16.0) * (3.0 * z * z - 1.0),
        -c(15.0, 4.0) * x * z,
        c(15.0, 16.0) * (x * x - y * y),
        -c(35.0, 32.0) * y * (3.0 * x * x - y * y),
        c(105.0, 4.0) * x * y * z,
        -c(21.0, 32.0) * y * (5.0 * z * z - 1.0),
        c(7.0, 16.0) * z * (5.0 * z * z - 3.0),
        -c(21.0, 32.0) * x * (5.0 * z * z - 1.0),
        c(105.0, 16.0) * z * (x * x - y * y),
        -c(35.0, 32.0) * x * (x * x - 3.0 * y * y),
    ]
}

/// The colour of a Gaussian as seen along a unit direction, unclamped.
pub(super) fn color(splats: &Splats, i: usize, direction: Vec3) -> Vec3 {
    let n = (splats.degree + 1).pow(2);
    let harmonics = &splats.harmonics[i * n..][..n];
    let terms = harmonics.iter().zip(basis(direction));
    Vec3::splat(0.5) + terms.map(|(c, y)| Vec3::from_array(*c) * y).sum::<Vec3>()
}

/// Unit directions all around.
pub(super) fn directions() -> Vec<Vec3> {
    let mut random = Random(3);
    (0..20)
        .map(|_| random.vector().normalize_or_zero())
        .collect()
}

/// Writes a file and reads it.
pub(super) fn read_bytes(name: &str, bytes: &[u8]) -> Splats {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    assert!(is_splats(&path), "{name} is not recognised");
    read(&path).unwrap()
}

/// The error of a file that must not be read but must be recognised.
pub(super) fn error_of(name: &str, bytes: &[u8]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    assert!(is_splats(&path), "{name} is not recognised");
    let Err(error) = read(&path) else {
        panic!("{name} was read");
    };
    let message = error.to_string();
    assert!(message.contains(name), "no file is named: {message}");
    message
}

/// Shortens a file at every sixteenth and damages it at random: it must be read or refused by name, and never panic.
pub(super) fn check_damaged(name: &str, whole: &[u8]) {
    check_damaged_inside(name, whole, <[u8]>::to_vec);
}

/// The same for what is wrapped up in a file, where damages meet no checksum.
pub(super) fn check_damaged_inside(name: &str, whole: &[u8], wrap: impl Fn(&[u8]) -> Vec<u8>) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    for i in 0..16 {
        let shortened = &whole[..whole.len() * i / 16];
        std::fs::write(&path, wrap(shortened)).unwrap();
        assert_eq!(fault(&path, name), None, "{i}/16 of {name}");
        assert!(read(&path).is_err(), "{i}/16 of {name} was read");
    }
    for seed in 0..N_SEEDS {
        let damaged = damaged(whole, &mut Random(seed));
        std::fs::write(&path, wrap(&damaged)).unwrap();
        assert_eq!(fault(&path, name), None, "{name}, seed {seed}");
    }
    let peak = peak_kb();
    assert!(peak < MAX_KB, "{peak} kB");
}

/// The file with one to four damages, half of them in its head.
fn damaged(whole: &[u8], random: &mut Random) -> Vec<u8> {
    let mut bytes = whole.to_vec();
    for _ in 0..=random.below(4) {
        if bytes.is_empty() {
            break;
        }
        let head = [bytes.len(), bytes.len().min(400)][random.below(2)];
        let at = random.below(head);
        let end = (at + 1 + random.below(16)).min(bytes.len());
        match random.below(6) {
            0 => bytes[at] ^= 1 << random.below(8),
            1 => bytes[at] = [0, 1, 127, 128, 255][random.below(5)],
            2 => bytes[at..end].fill(255),
            3 => bytes[at..end].fill(b'9'),
            4 => drop(bytes.drain(at..end)),
            _ => {
                let copy = bytes[at..end].to_vec();
                bytes.splice(at..at, copy);
            }
        }
    }
    bytes
}

/// What broke, if anything did.
fn fault(path: &Path, name: &str) -> Option<String> {
    match catch_unwind(AssertUnwindSafe(|| (is_splats(path), read(path)))) {
        Err(_panic) => Some("a panic".to_owned()),
        Ok((_, Err(error))) => {
            let message = error.to_string();
            (!message.contains(name)).then(|| format!("no file is named: {message}"))
        }
        Ok((_, Ok(splats))) => {
            let n = splats.splats.len();
            let is_whole = n > 0 && splats.harmonics.len() == n * (splats.degree + 1).pow(2);
            (!is_whole).then(|| "arrays of unequal length".to_owned())
        }
    }
}

/// The most memory that this process had, kilobytes; 0 where the system does not say.
fn peak_kb() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with("VmHWM:"));
    line.and_then(|line| line.split_whitespace().nth(1)?.parse().ok())
        .unwrap_or(0)
}
