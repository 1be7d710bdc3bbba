//! The `.ply` of the reference implementation (github.com/graphdeco-inria/gaussian-splatting, `GaussianModel.save_ply`), which
//! nearly every trainer writes: one float property a parameter, before its activation.
//!
//! Beyond the reference: any order, type and further properties; `red green blue` in place of `f_dc_*` (nerfstudio without
//! harmonics); `filter_3D`, the smoothing filter of Mip-Splatting (arXiv:2311.16493, Eq. 9), which is applied here; comments
//! that tell the screen filter (Brush: `SplatRenderMode: mip`, Postshot: `antialiased 1`; others do not say). Harmonics of a
//! fourth degree are left out.

use std::path::Path;

use glam::{Quat, Vec3};

use super::encoding::{MAX_DEGREE, constant_of, degree_of, sigmoid};
use super::ply_file::{Element, Field, PlyFile};
use super::{Collector, Splat, Splats};
use crate::data::DataError;

/// Where the parameters of a Gaussian lie in a record.
#[derive(Debug)]
struct Layout {
    center: [Field; 3],
    constant: Constant,
    /// Channel after channel.
    rest: Vec<Field>,
    degree: usize,
    opacity: Field,
    scale: [Field; 3],
    /// w, x, y, z.
    rotation: [Field; 4],
    filter: Option<Field>,
}

/// What is known of the colour in all directions.
#[derive(Debug)]
enum Constant {
    /// Its harmonic.
    Harmonic([Field; 3]),
    /// Itself, 0 to 255.
    Srgb([Field; 3]),
}

/// Whether a PLY holds Gaussians rather than a mesh or a point cloud.
pub(super) fn is_inria(file: &PlyFile) -> bool {
    file.element("vertex").is_some_and(|vertex| {
        let has = |name| vertex.field(name).is_some();
        has("scale_0") && (has("f_dc_0") || has("rot_0"))
    })
}

/// Reads the `vertex` element.
pub(super) fn read(path: &Path) -> Result<Splats, DataError> {
    let file = PlyFile::open(path)?;
    let missing = || DataError::unusable(path, "no element vertex");
    let vertex = file.element("vertex").ok_or_else(missing)?;
    let layout = Layout::of(path, vertex)?;
    let mut rows = file.rows(vertex)?;
    let mut found = Collector::new(vertex.n, layout.degree);
    let mut harmonics = vec![[0.0; 3]; (layout.degree + 1).pow(2)];
    for _ in 0..vertex.n {
        let row = rows.next()?;
        layout.read_harmonics(row, &mut harmonics);
        found.push(layout.splat(row), &harmonics);
    }
    let is_antialiased = layout.filter.is_some() || says_antialiased(&file.comments);
    found.finish(path, is_antialiased)
}

/// Whether the last comment about it says so.
pub(super) fn says_antialiased(comments: &[String]) -> bool {
    let mut told = comments.iter().rev().filter_map(|comment| {
        let comment = comment.trim().to_ascii_lowercase();
        let value = comment.strip_prefix("splatrendermode:");
        let value = value.or_else(|| comment.strip_prefix("antialiased "));
        Some(matches!(value?.trim(), "mip" | "1"))
    });
    told.next().unwrap_or(false)
}

impl Layout {
    fn of(path: &Path, vertex: &Element) -> Result<Self, DataError> {
        let constant = if vertex.field("f_dc_0").is_none() && vertex.field("red").is_some() {
            Constant::Srgb(vertex.fields(path, ["red", "green", "blue"])?)
        } else {
            Constant::Harmonic(vertex.fields(path, ["f_dc_0", "f_dc_1", "f_dc_2"])?)
        };
        let rest = vertex.series("f_rest_");
        let Some(degree) = degree_of(rest.len()) else {
            let n = rest.len();
            let problem =
                format!("element vertex: {n} properties f_rest_*, not 0, 9, 24, 45 or 72");
            return Err(DataError::unusable(path, problem));
        };
        let [opacity] = vertex.fields(path, ["opacity"])?;
        Ok(Self {
            center: vertex.fields(path, ["x", "y", "z"])?,
            constant,
            rest,
            degree: degree.min(MAX_DEGREE),
            opacity,
            scale: vertex.fields(path, ["scale_0", "scale_1", "scale_2"])?,
            rotation: vertex.fields(path, ["rot_0", "rot_1", "rot_2", "rot_3"])?,
            filter: vertex.field("filter_3D"),
        })
    }

    fn splat(&self, row: &[u8]) -> Splat {
        let vector = |fields: &[Field; 3]| Vec3::from_array(numbers(fields, row));
        let [w, x, y, z] = numbers(&self.rotation, row);
        let mut splat = Splat {
            center: vector(&self.center),
            scale: vector(&self.scale).exp(),
            rotation: Quat::from_xyzw(x, y, z, w),
            opacity: sigmoid(self.opacity.number(row)),
        };
        if let Some(filter) = &self.filter {
            smooth(&mut splat, filter.number(row));
        }
        splat
    }

    fn read_harmonics(&self, row: &[u8], harmonics: &mut [[f32; 3]]) {
        harmonics[0] = match &self.constant {
            Constant::Harmonic(fields) => numbers(fields, row),
            Constant::Srgb(fields) => constant_of(Vec3::from(numbers(fields, row)) / 255.0),
        };
        let n_rest = self.rest.len() / 3;
        for (i, harmonic) in harmonics[1..].iter_mut().enumerate() {
            *harmonic = [0, 1, 2].map(|channel| self.rest[channel * n_rest + i].number(row));
        }
    }
}

fn numbers<const N: usize>(fields: &[Field; N], row: &[u8]) -> [f32; N] {
    fields.each_ref().map(|field| field.number(row))
}

/// Widens a Gaussian by a filter of this standard deviation, scene units, and keeps its integral (Mip-Splatting's 3D filter).
fn smooth(splat: &mut Splat, filter: f32) {
    let narrow = splat.scale;
    splat.scale = (narrow * narrow + filter * filter).map(f32::sqrt);
    splat.opacity *= (narrow / splat.scale).element_product();
}

#[cfg(test)]
mod tests {
    use std::fmt::Write as _;

    use super::super::test_files::{
        check_damaged, color, directions, error_of, random_splats, read_bytes,
    };
    use super::super::{is_splats, read};
    use super::*;

    /// A column of a test file.
    type Column<'a> = (String, Box<dyn Fn(usize) -> f32 + 'a>);

    /// What the reference writes, but for the normals.
    fn columns(splats: &Splats) -> Vec<Column<'_>> {
        fn add<'a>(all: &mut Vec<Column<'a>>, name: &str, value: impl Fn(usize) -> f32 + 'a) {
            all.push((name.to_owned(), Box::new(value)));
        }
        let n = (splats.degree + 1).pow(2);
        let mut all = Vec::new();
        for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
            add(&mut all, name, move |i| splats.splats[i].center[axis]);
        }
        for channel in 0..3 {
            let name = format!("f_dc_{channel}");
            add(&mut all, &name, move |i| splats.harmonics[i * n][channel]);
        }
        for rest in 0..3 * (n - 1) {
            let (channel, k) = (rest / (n - 1), rest % (n - 1));
            let value = move |i: usize| splats.harmonics[i * n + 1 + k][channel];
            add(&mut all, &format!("f_rest_{rest}"), value);
        }
        let logit = |p: f32| (p / (1.0 - p)).ln();
        add(&mut all, "opacity", move |i| {
            logit(splats.splats[i].opacity)
        });
        for axis in 0..3 {
            let value = move |i: usize| splats.splats[i].scale[axis].ln();
            add(&mut all, &format!("scale_{axis}"), value);
        }
        for (k, axis) in [3, 0, 1, 2].into_iter().enumerate() {
            // Not unit, as trainers leave them.
            let value = move |i: usize| splats.splats[i].rotation.to_array()[axis] * 3.0;
            add(&mut all, &format!("rot_{k}"), value);
        }
        all
    }

    fn header(format: &str, comment: &str, n: usize, columns: &[Column<'_>]) -> String {
        let mut text = format!("ply\nformat {format} 1.0\n{comment}element vertex {n}\n");
        for (name, _) in columns {
            writeln!(text, "property float {name}").unwrap();
        }
        text + "end_header\n"
    }

    fn binary(comment: &str, n: usize, columns: &[Column<'_>]) -> Vec<u8> {
        let mut bytes = header("binary_little_endian", comment, n, columns).into_bytes();
        for i in 0..n {
            bytes.extend(columns.iter().flat_map(|(_, value)| value(i).to_le_bytes()));
        }
        bytes
    }

    fn assert_close(found: &Splats, expected: &Splats) {
        assert_eq!(found.splats.len(), expected.splats.len());
        assert_eq!(found.degree, expected.degree);
        for (i, (a, b)) in found.splats.iter().zip(&expected.splats).enumerate() {
            assert_eq!(a.center, b.center);
            assert!(a.scale.abs_diff_eq(b.scale, 1e-5), "{i}: {}", a.scale);
            assert!(a.rotation.dot(b.rotation).abs() > 1.0 - 1e-6, "{i}");
            assert!((a.opacity - b.opacity).abs() < 1e-6, "{i}: {}", a.opacity);
            for d in directions() {
                let (a, b) = (color(found, i, d), color(expected, i, d));
                assert!(a.abs_diff_eq(b, 1e-5), "{i} along {d}: {a}, {b}");
            }
        }
    }

    #[test]
    fn gaussians_of_each_degree_are_read_back_whatever_the_order_and_the_extras() {
        for degree in 0..=3 {
            let splats = random_splats(20, degree);
            let mut columns = columns(&splats);
            assert_close(&read_bytes("a.ply", &binary("", 20, &columns)), &splats);
            columns.reverse();
            columns.insert(3, ("nx".to_owned(), Box::new(|_| f32::NAN)));
            assert_close(&read_bytes("a.ply", &binary("", 20, &columns)), &splats);
        }
    }

    #[test]
    fn ascii_big_endian_and_other_types_are_read_too() {
        let splats = random_splats(20, 1);
        let columns = columns(&splats);
        let faces = "element before 2\nproperty uchar a\nproperty double b\n";
        let text = header("ascii", faces, 20, &columns);
        let rows = (0..20).map(|i| {
            let numbers = columns.iter().map(|(_, value)| value(i).to_string());
            numbers.collect::<Vec<_>>().join(" ")
        });
        let text = text + "1 2\n3 4\n" + &rows.collect::<Vec<_>>().join("\n");
        assert_close(&read_bytes("a.ply", text.as_bytes()), &splats);

        let text = header("binary_big_endian", faces, 20, &columns);
        let mut bytes = text.replace("float f_", "double f_").into_bytes();
        bytes.extend([0; 18]);
        for i in 0..20 {
            for (name, value) in &columns {
                if name.starts_with("f_") {
                    bytes.extend(f64::from(value(i)).to_be_bytes());
                } else {
                    bytes.extend(value(i).to_be_bytes());
                }
            }
        }
        assert_close(&read_bytes("a.ply", &bytes), &splats);
    }

    #[test]
    fn harmonics_are_those_of_the_reference() {
        // Red grows against x, green along z, blue is 4 x y z.
        let mut splats = random_splats(1, 3);
        splats.harmonics.fill([0.0; 3]);
        let columns = columns(&splats);
        let mut bytes = binary("", 1, &columns);
        let first = bytes.len() - columns.len() * 4;
        for (name, value) in [
            ("f_rest_2", 1.0_f32),
            ("f_rest_16", 1.0),
            ("f_rest_39", 1.0),
        ] {
            let column = columns.iter().position(|(other, _)| other == name).unwrap();
            bytes[first + column * 4..][..4].copy_from_slice(&value.to_le_bytes());
        }
        let splats = read_bytes("a.ply", &bytes);
        // C1 and C3[1] of `sh_utils.py`.
        let (c1, c3) = (0.488_602_5, 2.890_611_4);
        for d in directions() {
            let expected = Vec3::new(-c1 * d.x, c1 * d.z, c3 * d.x * d.y * d.z) + 0.5;
            let found = color(&splats, 0, d);
            assert!(found.abs_diff_eq(expected, 1e-5), "{found}, {expected}");
        }
    }

    #[test]
    fn the_screen_filter_is_told_by_comments_and_the_smoothing_filter_is_applied() {
        let splats = random_splats(3, 0);
        let mut columns = columns(&splats);
        let is_antialiased = |comment: &str, columns: &[Column<'_>]| {
            read_bytes("a.ply", &binary(comment, 3, columns)).is_antialiased
        };
        assert!(!is_antialiased("", &columns));
        assert!(!is_antialiased("comment antialiased 0\n", &columns));
        assert!(is_antialiased("comment antialiased 1\n", &columns));
        assert!(is_antialiased("comment SplatRenderMode: mip\n", &columns));
        let last = "comment SplatRenderMode: mip\ncomment SplatRenderMode: default\n";
        assert!(!is_antialiased(last, &columns));
        columns.push(("filter_3D".to_owned(), Box::new(|_| 0.2)));
        let found = read_bytes("a.ply", &binary("", 3, &columns));
        assert!(found.is_antialiased, "filter_3D");
        for (a, b) in found.splats.iter().zip(&splats.splats) {
            let scale = (b.scale * b.scale + 0.04).map(f32::sqrt);
            assert!(a.scale.abs_diff_eq(scale, 1e-5), "{}", a.scale);
            let integral = |s: &Splat| s.opacity * s.scale.element_product();
            let ratio = integral(a) / integral(b);
            assert!((ratio - 1.0).abs() < 1e-4, "{ratio}");
        }
    }

    #[test]
    fn plain_colours_are_read_in_place_of_harmonics() {
        let splats = random_splats(2, 0);
        let mut columns = columns(&splats);
        columns.retain(|(name, _)| !name.starts_with("f_dc"));
        for (name, value) in [("red", 255.0), ("green", 0.0), ("blue", 51.0)] {
            columns.push((name.to_owned(), Box::new(move |_| value)));
        }
        let found = read_bytes("a.ply", &binary("", 2, &columns));
        let rgb = color(&found, 1, Vec3::X);
        assert!(rgb.abs_diff_eq(Vec3::new(1.0, 0.0, 0.2), 1e-5), "{rgb}");
    }

    #[test]
    fn meshes_and_point_clouds_are_no_splats() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mesh.ply");
        let colors = "property uchar red\nproperty uchar green\nproperty uchar blue\n";
        for extra in ["", colors, "property float opacity\n"] {
            let text = format!(
                "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n{extra}\
                 element face 0\nproperty list uchar int vertex_indices\nend_header\n0 0 0 0 0 0\n"
            );
            std::fs::write(&path, text).unwrap();
            assert!(!is_splats(&path), "{extra}");
            assert!(read(&path).is_err(), "{extra}");
        }
    }

    #[test]
    fn what_is_wrong_is_named() {
        let splats = random_splats(4, 1);
        for missing in ["y", "opacity", "scale_2", "rot_3", "f_dc_1"] {
            let mut columns = columns(&splats);
            columns.retain(|(name, _)| name != missing);
            let message = error_of("a.ply", &binary("", 4, &columns));
            assert!(message.contains(missing), "{message}");
        }
        let mut columns = columns(&splats);
        columns.retain(|(name, _)| name != "f_rest_8");
        let message = error_of("a.ply", &binary("", 4, &columns));
        assert!(message.contains("f_rest"), "{message}");
    }

    #[test]
    fn more_gaussians_than_fit_into_the_file_are_refused() {
        let splats = random_splats(4, 1);
        let whole = binary("", 4, &columns(&splats));
        let at = whole.windows(9).position(|w| w == b"vertex 4\n").unwrap();
        for n in ["5", "4000000000", "9999999999999999999"] {
            let head = [&whole[..at], b"vertex ", n.as_bytes()].concat();
            let message = error_of("a.ply", &[&head, &whole[at + 8..]].concat());
            assert!(message.contains("do not fit"), "{message}");
        }
    }

    #[test]
    fn damaged_files_are_read_or_refused() {
        let splats = random_splats(30, 2);
        check_damaged("a.ply", &binary("", 30, &columns(&splats)));
    }

    #[test]
    fn a_real_scan_is_read() {
        let file = "../shared/data/real/radiance_fields/point_cloud_3dgs.ply";
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(file);
        if !path.exists() {
            println!("skipped: no {}", path.display());
            return;
        }
        let splats = read(&path).unwrap();
        assert_eq!((splats.splats.len(), splats.degree), (9080, 3));
        assert_eq!(splats.harmonics.len(), 9080 * 16);
        // As numpy finds them.
        let n_opaque = splats.splats.iter().filter(|s| s.opacity > 0.5).count();
        assert_eq!(n_opaque, 487);
        let scales = splats.splats.iter().map(|s| s.scale);
        let most = scales.clone().map(Vec3::max_element).fold(0.0, f32::max);
        let least = scales.map(Vec3::min_element).fold(f32::MAX, f32::min);
        assert!((most - 266.75266).abs() < 1e-2, "{most}");
        assert!((least - 0.005_618_753).abs() < 1e-6, "{least}");
    }
}
