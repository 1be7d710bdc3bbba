//! `.sog` of `PlayCanvas`, version 2 (github.com/playcanvas/splat-transform, `read-sog.ts`): a zip archive, or its unpacked
//! files by their `meta.json`, with a lossless WebP picture a parameter and a pixel a Gaussian.

use std::path::Path;

use glam::{Quat, Vec3};
use image::RgbaImage;
use serde::Deserialize;

use super::encoding::{MAX_DEGREE, N_REST, check_expansion, smallest_three};
use super::sog_files::{Files, META};
use super::{Collector, Splat, Splats, has_extension};
use crate::data::DataError;

/// Largest `meta.json`, bytes.
const MAX_META: u64 = 1 << 20;
/// Sets of harmonics in a row of the palette, and at most in it.
const N_IN_ROW: usize = 64;
const MAX_PALETTE: usize = 1 << 16;
/// The fourth channel of a rotation: this plus the index of the largest component.
const FIRST_TAG: u8 = 252;

/// `meta.json`.
#[derive(Debug, Deserialize)]
struct Meta {
    count: usize,
    /// Newer writers.
    #[serde(default)]
    model: String,
    /// Older ones.
    #[serde(default)]
    antialias: bool,
    means: Means,
    scales: Coded,
    quats: Pictures,
    sh0: Coded,
    #[serde(rename = "shN")]
    sh_n: Option<Palette>,
}

/// Signed logarithms of the positions, 16 bits in two pictures.
#[derive(Debug, Deserialize)]
struct Means {
    mins: [f32; 3],
    maxs: [f32; 3],
    files: [String; 2],
}

/// Numbers by their index.
#[derive(Debug, Deserialize)]
struct Coded {
    codebook: Vec<f32>,
    files: [String; 1],
}

#[derive(Debug, Deserialize)]
struct Pictures {
    files: [String; 1],
}

/// Harmonics by their index among sets of them.
#[derive(Debug, Deserialize)]
struct Palette {
    count: usize,
    bands: usize,
    codebook: Vec<f32>,
    /// The sets, and the index of each Gaussian's.
    files: [String; 2],
}

/// What a Gaussian's harmonics are looked up in.
#[derive(Debug)]
struct Harmonics {
    degree: usize,
    sets: RgbaImage,
    n_sets: usize,
    labels: RgbaImage,
    codebook: [f32; 256],
}

/// Whether a zip archive or a JSON file describes Gaussians, of whatever version; damaged ones by their name.
pub(super) fn is_sog(path: &Path) -> bool {
    if has_extension(path, "sog") {
        return true;
    }
    let meta = Files::open(path).and_then(|mut files| files.read(META, MAX_META));
    let meta = meta
        .ok()
        .and_then(|meta| serde_json::from_slice(&meta).ok());
    let meta: serde_json::Value = meta.unwrap_or_default();
    let keys = ["means", "scales", "quats", "sh0"];
    keys.iter().all(|key| meta.get(key).is_some())
}

/// Reads an archive or, by their `meta.json`, the files of one.
pub(super) fn read(path: &Path) -> Result<Splats, DataError> {
    let broken = |problem: String| DataError::unusable(path, problem);
    let mut files = Files::open(path).map_err(broken)?;
    let meta = files.read(META, MAX_META).and_then(|json| Meta::of(&json));
    let meta = meta.map_err(broken)?;
    let found = read_gaussians(&meta, &mut files).map_err(broken)?;
    found.finish(path, meta.antialias || meta.model == "antialiased")
}

/// The Gaussians; a text where a file or a number of `meta.json` is wrong.
fn read_gaussians(meta: &Meta, files: &mut Files) -> Result<Collector, String> {
    let n = meta.count;
    // Low bytes are noise, which hardly packs: who claims more Gaussians than they allow has an empty picture of any size.
    let n_low = files.read(&meta.means.files[0], u64::MAX)?.len();
    check_expansion(n_low as u64, (n as u64).saturating_mul(4))?;
    let mut picture = |name: &String| files.picture(name, n);
    let [low, high] = [
        picture(&meta.means.files[0])?,
        picture(&meta.means.files[1])?,
    ];
    let [scales, rotations] = [
        picture(&meta.scales.files[0])?,
        picture(&meta.quats.files[0])?,
    ];
    let colors = picture(&meta.sh0.files[0])?;
    let scale_codes = codebook("scales", &meta.scales.codebook)?;
    let color_codes = codebook("sh0", &meta.sh0.codebook)?;
    let rest = meta.sh_n.as_ref().filter(|palette| palette.bands > 0);
    let rest = rest
        .map(|palette| Harmonics::open(palette, files, n))
        .transpose()?;
    let degree = rest.as_ref().map_or(0, |rest| rest.degree);
    let mut found = Collector::new(n, degree);
    let mut harmonics = vec![[0.0; 3]; (degree + 1).pow(2)];
    for i in 0..n {
        let [r, g, b, opacity] = pixel(&colors, i);
        let [x, y, z, _] = pixel(&scales, i);
        let splat = Splat {
            center: meta.means.position(pixel(&low, i), pixel(&high, i)),
            scale: Vec3::from_array([x, y, z].map(|code| scale_codes[usize::from(code)])).exp(),
            rotation: rotation(pixel(&rotations, i)),
            opacity: f32::from(opacity) / 255.0,
        };
        harmonics[0] = [r, g, b].map(|code| color_codes[usize::from(code)]);
        if let Some(rest) = &rest {
            rest.look_up(i, &mut harmonics[1..]);
        }
        found.push(splat, &harmonics);
    }
    Ok(found)
}

impl Meta {
    fn of(json: &[u8]) -> Result<Self, String> {
        let wrong = |e| format!("{META}: {e}");
        let value: serde_json::Value = serde_json::from_slice(json).map_err(wrong)?;
        match value.get("version").map(serde_json::Value::as_u64) {
            Some(Some(2)) => serde_json::from_value(value).map_err(wrong),
            None => Err(format!("{META}: version 1 of .sog is not supported, 2 is")),
            Some(_) => Err(format!(
                "{META}: this version of .sog is not supported, 2 is"
            )),
        }
    }
}

impl Means {
    fn position(&self, low: [u8; 4], high: [u8; 4]) -> Vec3 {
        Vec3::from_array([0, 1, 2].map(|axis| {
            let t = f32::from(u16::from_le_bytes([low[axis], high[axis]])) / 65535.0;
            let log = self.mins[axis] * (1.0 - t) + self.maxs[axis] * t;
            log.signum() * log.abs().exp_m1()
        }))
    }
}

impl Harmonics {
    fn open(palette: &Palette, files: &mut Files, n: usize) -> Result<Self, String> {
        let Palette { count, bands, .. } = palette;
        if *bands > MAX_DEGREE || *count > MAX_PALETTE {
            return Err(format!(
                "{META}: shN: {count} sets of harmonics of degree {bands}"
            ));
        }
        let n_coefficients = N_REST[*bands];
        let n_pixels = count.div_ceil(N_IN_ROW) * N_IN_ROW * n_coefficients;
        let sets = files.picture(&palette.files[0], n_pixels)?;
        let width = N_IN_ROW * n_coefficients;
        if sets.width() as usize != width {
            let name = &palette.files[0];
            return Err(format!("{name}: {} pixels wide, not {width}", sets.width()));
        }
        Ok(Self {
            degree: *bands,
            sets,
            n_sets: *count,
            labels: files.picture(&palette.files[1], n)?,
            codebook: codebook("shN", &palette.codebook)?,
        })
    }

    /// The harmonics of the `i`th Gaussian beyond the constant one; zero where its set is not in the palette.
    fn look_up(&self, i: usize, harmonics: &mut [[f32; 3]]) {
        let [low, high, ..] = pixel(&self.labels, i);
        let label = usize::from(u16::from_le_bytes([low, high]));
        if label >= self.n_sets {
            return harmonics.fill([0.0; 3]);
        }
        // Sets follow one another in rows, and rows one another.
        let first = label * N_REST[self.degree];
        for (k, harmonic) in harmonics.iter_mut().enumerate() {
            let [r, g, b, _] = pixel(&self.sets, first + k);
            *harmonic = [r, g, b].map(|code| self.codebook[usize::from(code)]);
        }
    }
}

/// The `i`th pixel.
fn pixel(picture: &RgbaImage, i: usize) -> [u8; 4] {
    picture.as_raw().as_chunks().0[i]
}

fn codebook(name: &str, numbers: &[f32]) -> Result<[f32; 256], String> {
    let wrong = || {
        format!(
            "{META}: {name}.codebook: {} numbers, not 256",
            numbers.len()
        )
    };
    numbers.first_chunk().copied().ok_or_else(wrong)
}

/// Of w, x, y, z the index of the largest in the last channel, the others in the first ones.
fn rotation([a, b, c, tag]: [u8; 4]) -> Quat {
    let Some(largest) = tag.checked_sub(FIRST_TAG) else {
        return Quat::IDENTITY;
    };
    let other = |byte| (f32::from(byte) / 255.0 * 2.0 - 1.0) * std::f32::consts::FRAC_1_SQRT_2;
    let [w, x, y, z] = smallest_three(usize::from(largest), [a, b, c].map(other));
    Quat::from_xyzw(x, y, z, w)
}

#[cfg(test)]
mod tests {
    use std::io::{Cursor, Write as _};

    use image::ExtendedColorType;
    use image::codecs::webp::WebPEncoder;
    use serde_json::json;
    use zip::ZipWriter;
    use zip::write::SimpleFileOptions;

    use super::super::test_files::{
        check_damaged, check_damaged_inside, color, directions, error_of, random_splats, read_bytes,
    };
    use super::super::{is_splats, read};
    use super::*;

    type Contents = Vec<(&'static str, Vec<u8>)>;

    fn webp(width: usize, pixels: &[[u8; 4]]) -> Vec<u8> {
        let height = pixels.len().div_ceil(width);
        let mut pixels = pixels.to_vec();
        pixels.resize(width * height, [0; 4]);
        let mut bytes = Vec::new();
        let encoder = WebPEncoder::new_lossless(&mut bytes);
        let [width, height] = [width as u32, height as u32];
        let data = pixels.as_flattened();
        encoder
            .encode(data, width, height, ExtendedColorType::Rgba8)
            .unwrap();
        bytes
    }

    /// A codebook from -`most` to `most`, and a number's index in it.
    fn codes(most: f32) -> (Vec<f32>, impl Fn(f32) -> u8) {
        let codebook = (0..256).map(|i| (i as f32 / 127.5 - 1.0) * most).collect();
        (codebook, move |v: f32| {
            ((v / most + 1.0) * 127.5).round() as u8
        })
    }

    /// The files of an archive by the format's description.
    fn files_of(splats: &Splats) -> Contents {
        let n = (splats.degree + 1).pow(2);
        let (scale_codes, scale_code) = codes(6.0);
        let (harmonic_codes, harmonic_code) = codes(1.0);
        let mut pictures = [(); 5].map(|()| Vec::new());
        for (splat, harmonics) in splats.splats.iter().zip(splats.harmonics.chunks(n)) {
            let position = splat.center.to_array().map(|v| {
                let log = v.signum() * v.abs().ln_1p();
                ((log + 2.0) / 4.0 * 65535.0).round() as u16
            });
            let [x, y, z] = position.map(u16::to_le_bytes);
            pictures[0].push([x[0], y[0], z[0], 255]);
            pictures[1].push([x[1], y[1], z[1], 255]);
            let [x, y, z] = splat.scale.to_array().map(|s| scale_code(s.ln()));
            pictures[2].push([x, y, z, 255]);
            let [x, y, z, w] = splat.rotation.to_array();
            let all = [w, x, y, z];
            let largest = (0..4).max_by(|a, b| all[*a].abs().total_cmp(&all[*b].abs()));
            let largest = largest.unwrap();
            let others = (0..4).filter(|k| *k != largest).map(|k| {
                let v = all[k] * all[largest].signum() * 2.0_f32.sqrt();
                ((v * 0.5 + 0.5) * 255.0).round() as u8
            });
            let others: Vec<u8> = others.collect();
            pictures[3].push([others[0], others[1], others[2], 252 + largest as u8]);
            let [r, g, b] = harmonics[0].map(&harmonic_code);
            pictures[4].push([r, g, b, (splat.opacity * 255.0).round() as u8]);
        }
        let mut meta = json!({
            "version": 2, "count": splats.splats.len(), "model": "antialiased",
            "means": {"mins": [-2.0, -2.0, -2.0], "maxs": [2.0, 2.0, 2.0], "files": ["means_l.webp", "means_u.webp"]},
            "scales": {"codebook": scale_codes, "files": ["scales.webp"]},
            "quats": {"files": ["quats.webp"]},
            "sh0": {"codebook": harmonic_codes, "files": ["sh0.webp"]},
        });
        let names = [
            "means_l.webp",
            "means_u.webp",
            "scales.webp",
            "quats.webp",
            "sh0.webp",
        ];
        let pictures = pictures.iter().map(|pixels| webp(12, pixels));
        let mut files: Contents = names.into_iter().zip(pictures).collect();
        if n > 1 {
            // Each Gaussian has a set of its own, the last one first.
            let n_sets = splats.splats.len();
            meta["shN"] = json!({
                "count": n_sets, "bands": splats.degree, "codebook": harmonic_codes,
                "files": ["shN_centroids.webp", "shN_labels.webp"],
            });
            let sets = splats.harmonics.chunks(n).rev().flat_map(|set| &set[1..]);
            let sets = sets.map(|h| {
                let [r, g, b] = h.map(&harmonic_code);
                [r, g, b, 255]
            });
            let sets: Vec<[u8; 4]> = sets.collect();
            files.push(("shN_centroids.webp", webp(64 * (n - 1), &sets)));
            let label = |i: usize| {
                let [low, high] = ((n_sets - 1 - i) as u16).to_le_bytes();
                [low, high, 0, 255]
            };
            let labels: Vec<[u8; 4]> = (0..n_sets).map(label).collect();
            files.push(("shN_labels.webp", webp(12, &labels)));
        }
        files.push((META, meta.to_string().into_bytes()));
        files
    }

    fn archive(files: &Contents) -> Vec<u8> {
        let mut writer = ZipWriter::new(Cursor::new(Vec::new()));
        for (name, bytes) in files {
            writer
                .start_file(*name, SimpleFileOptions::default())
                .unwrap();
            writer.write_all(bytes).unwrap();
        }
        writer.finish().unwrap().into_inner()
    }

    fn assert_close(found: &Splats, written: &Splats) {
        assert_eq!(found.splats.len(), written.splats.len());
        assert_eq!(found.degree, written.degree);
        for (i, (a, b)) in found.splats.iter().zip(&written.splats).enumerate() {
            assert!(a.center.abs_diff_eq(b.center, 2e-4), "{i}: {}", a.center);
            let ratio = (a.scale / b.scale).map(f32::ln).abs().max_element();
            assert!(ratio < 3.01 / 127.0, "{i}: {ratio}");
            assert!(a.rotation.dot(b.rotation).abs() > 1.0 - 1e-4, "{i}");
            assert!((a.opacity - b.opacity).abs() < 0.51 / 255.0, "{i}");
            for d in directions() {
                let (a, b) = (color(found, i, d), color(written, i, d));
                assert!(a.abs_diff_eq(b, 0.03), "{i} along {d}: {a}, {b}");
            }
        }
    }

    #[test]
    fn gaussians_are_read_back_from_an_archive_and_from_a_folder() {
        for degree in 0..=3 {
            let splats = random_splats(100, degree);
            let files = files_of(&splats);
            let found = read_bytes("a.sog", &archive(&files));
            assert!(found.is_antialiased, "model");
            assert_close(&found, &splats);
            assert_close(&read_bytes("a.zip", &archive(&files)), &splats);
            let folder = tempfile::tempdir().unwrap();
            for (name, bytes) in &files {
                std::fs::write(folder.path().join(name), bytes).unwrap();
            }
            let path = folder.path().join(META);
            assert!(is_splats(&path), "folder");
            assert_close(&read(&path).unwrap(), &splats);
        }
    }

    #[test]
    fn other_archives_and_json_files_are_no_splats() {
        let folder = tempfile::tempdir().unwrap();
        let json = b"{\"version\": 2, \"frames\": []}".to_vec();
        let zip = archive(&vec![(META, json.clone())]);
        for (name, bytes) in [(META, json), ("a.zip", zip)] {
            let path = folder.path().join(name);
            std::fs::write(&path, bytes).unwrap();
            assert!(!is_splats(&path), "{name}");
        }
    }

    #[test]
    fn what_is_wrong_is_named() {
        let splats = random_splats(100, 1);
        let changed = |from: &str, to: &str| {
            let mut files = files_of(&splats);
            let (_, meta) = files.last_mut().unwrap();
            let text = String::from_utf8_lossy(meta).replace(from, to);
            *meta = text.into_bytes();
            error_of("a.sog", &archive(&files))
        };
        assert!(
            changed("\"version\":2", "\"version\":3").contains("version"),
            "version"
        );
        assert!(
            changed(",\"version\":2", "").contains("version 1"),
            "version 1"
        );
        assert!(
            changed("quats.webp", "gone.webp").contains("gone.webp"),
            "file"
        );
        assert!(
            changed("\"count\":100", "\"count\":999").contains("means_l.webp"),
            "few"
        );
        let many = changed("\"count\":100", "\"count\":999999999999");
        assert!(many.contains("cannot hold"), "{many}");
        assert!(
            changed("\"bands\":1", "\"bands\":9").contains("shN"),
            "bands"
        );
        assert!(
            changed("\"codebook\":[-6.0,", "\"codebook\":[").contains("scales"),
            "codebook"
        );
    }

    #[test]
    fn damaged_files_are_read_or_refused() {
        let files = files_of(&random_splats(30, 1));
        check_damaged("a.sog", &archive(&files));
        // Low bytes, sets of harmonics, meta.json.
        for i in [0, 5, 7] {
            check_damaged_inside("a.sog", &files[i].1, |bytes| {
                let mut files = files.clone();
                files[i].1 = bytes.to_vec();
                archive(&files)
            });
        }
    }
}
