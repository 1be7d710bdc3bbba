//! The original network in both programs' layouts.

use glam::Vec3;

use super::*;
use crate::data::DataError;

/// Layers of a small network by name, with sizes in and out.
fn small(program: usize) -> Vec<(String, usize, usize)> {
    let (xyz, dir, w) = (3 + 6 * 4, 3 + 6 * 2, 16);
    let list = |name: &str, skip: usize, first: Vec<(String, usize, usize)>, n: usize| {
        let rest = (first.len()..n).map(|i| {
            let index = if name == "layers_xyz" { i - 1 } else { i };
            (
                format!("{name}.{index}"),
                if i == skip { w + xyz } else { w },
                w,
            )
        });
        first.iter().cloned().chain(rest).collect::<Vec<_>>()
    };
    if program == 0 {
        let mut layers = list("layers_xyz", 5, vec![("layer1".to_owned(), xyz, w)], 7);
        layers.extend([
            ("fc_feat".to_owned(), w, w),
            ("fc_alpha".to_owned(), w, 1),
            ("layers_dir.0".to_owned(), w + dir, w / 2),
            ("fc_rgb".to_owned(), w / 2, 3),
        ]);
        return layers;
    }
    let mut layers = list(
        "pts_linears",
        5,
        vec![("pts_linears.0".to_owned(), xyz, w)],
        8,
    );
    layers.extend([
        ("feature_linear".to_owned(), w, w),
        ("alpha_linear".to_owned(), w, 1),
        ("views_linears.0".to_owned(), w + dir, w / 2),
        ("rgb_linear".to_owned(), w / 2, 3),
    ]);
    layers
}

fn tensors(layers: &[(String, usize, usize)]) -> Vec<TestTensor> {
    let mut random = Random(3);
    let pairs = layers.iter().flat_map(|(name, n_in, n_out)| {
        let scale = 1.6 / (*n_in as f32).sqrt();
        [
            tensor(
                &format!("{name}.weight"),
                &[*n_out, *n_in],
                random.numbers(n_out * n_in, scale),
            ),
            // So that there is a density in many places.
            tensor(
                &format!("{name}.bias"),
                &[*n_out],
                if *n_out == 1 {
                    vec![0.5]
                } else {
                    random.numbers(*n_out, 0.3)
                },
            ),
        ]
    });
    pairs.collect()
}

fn encoded(v: Vec3, n: i32) -> Vec<f64> {
    let v = v.to_array().map(f64::from);
    let mut out = v.to_vec();
    for k in 0..n {
        let scale = 2_f64.powi(k);
        out.extend(v.map(|x| (scale * x).sin()));
        out.extend(v.map(|x| (scale * x).cos()));
    }
    out
}

/// The forward pass of either program, layer by layer as its source has it.
fn reference(program: usize, tensors: &[TestTensor], p: Vec3, d: Vec3) -> (f64, [f64; 3]) {
    let values = |name: String| &tensors.iter().find(|t| t.name == name).unwrap().values;
    let linear = |name: &str, x: &[f64]| -> Vec<f64> {
        let (weight, bias) = (
            values(format!("{name}.weight")),
            values(format!("{name}.bias")),
        );
        assert_eq!(weight.len(), bias.len() * x.len(), "{name} fits");
        let rows = weight.chunks(x.len()).zip(bias);
        let sum = |row: &[f32]| {
            row.iter()
                .zip(x)
                .map(|(w, x)| f64::from(*w) * x)
                .sum::<f64>()
        };
        rows.map(|(row, bias)| sum(row) + f64::from(*bias))
            .collect()
    };
    let relu = |x: Vec<f64>| x.into_iter().map(|x| x.max(0.0)).collect::<Vec<_>>();
    let (xyz, view) = (encoded(p, 4), encoded(d, 2));
    let (density, feature, names) = if program == 0 {
        let mut x = linear("layer1", &xyz);
        for i in 0..6 {
            if i == 4 {
                x.extend(&xyz);
            }
            x = relu(linear(&format!("layers_xyz.{i}"), &x));
        }
        let feature = relu(linear("fc_feat", &x));
        (linear("fc_alpha", &x), feature, ["layers_dir.0", "fc_rgb"])
    } else {
        let mut h = xyz.clone();
        for i in 0..8 {
            h = relu(linear(&format!("pts_linears.{i}"), &h));
            if i == 4 {
                h = [xyz.clone(), h].concat();
            }
        }
        let feature = linear("feature_linear", &h);
        (
            linear("alpha_linear", &h),
            feature,
            ["views_linears.0", "rgb_linear"],
        )
    };
    let h = relu(linear(names[0], &[feature, view].concat()));
    let color = linear(names[1], &h);
    let color = [0, 1, 2].map(|i| 1.0 / (1.0 + (-color[i]).exp()));
    (density[0].max(0.0), color)
}

#[test]
fn both_programs_in_both_layouts_answer_as_their_sources_do() {
    let folder = tempfile::tempdir().unwrap();
    for (program, outer) in [
        (0, "model_coarse_state_dict"),
        (0, "model_fine_state_dict"),
        (1, "network_fn_state_dict"),
        (1, "network_fine_state_dict"),
    ] {
        let tensors = tensors(&small(program));
        for bytes in [
            zip_checkpoint(outer, &tensors),
            legacy_checkpoint(outer, &tensors),
        ] {
            let path = write(folder.path(), "a.tar", &bytes);
            assert!(is_nerf(&path), "{outer} is recognised");
            let nerf = read(&path).unwrap();
            assert_answers(&nerf, 1.2, |p, d| reference(program, &tensors, p, d));
        }
    }
}

#[test]
fn a_network_without_directions_is_read() {
    let layers = [("pts_linears.0", 27, 16), ("output_linear", 16, 5)];
    let layers = layers.map(|(name, n_in, n_out)| (name.to_owned(), n_in, n_out));
    let folder = tempfile::tempdir().unwrap();
    let bytes = zip_checkpoint("network_fn_state_dict", &tensors(&layers));
    let nerf = read(&write(folder.path(), "a.tar", &bytes)).unwrap();
    let (point, x) = (Vec3::splat(0.3), Vec3::X);
    assert_eq!(
        ask(&nerf, point, x),
        ask(&nerf, point, Vec3::Y),
        "the same from everywhere"
    );
    assert!(
        nerf.describe().contains("1 layers of 16"),
        "{}",
        nerf.describe()
    );
}

fn problem_of(tensors: &[TestTensor]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let bytes = zip_checkpoint("network_fn_state_dict", tensors);
    let result: Result<Nerf, DataError> = read(&write(folder.path(), "a.tar", &bytes));
    result.err().unwrap().to_string()
}

#[test]
fn faults_name_the_file_and_the_tensor() {
    let whole = || tensors(&small(1));
    for (name, shape, expected) in [
        (
            "pts_linears.3.weight",
            vec![16, 20],
            "pts_linears: takes 20 numbers where 16",
        ),
        ("pts_linears.0.weight", vec![16, 28], "no position in sines"),
        ("alpha_linear.weight", vec![2, 16], "alpha_linear"),
        ("rgb_linear.weight", vec![3, 9], "rgb_linear: is (9, 3)"),
        ("views_linears.0.weight", vec![8, 17], "views_linears"),
        (
            "feature_linear.weight",
            vec![256],
            "feature_linear.weight: no matrix",
        ),
        (
            "feature_linear.weight",
            vec![1 << 20, 16],
            "a matrix of 1048576 by 16",
        ),
    ] {
        let mut tensors = whole();
        let tensor = tensors
            .iter_mut()
            .find(|tensor| tensor.name == name)
            .unwrap();
        let n: usize = shape.iter().product();
        tensor.values.resize(n.min(4096), 0.1);
        tensor.shape = shape;
        let n_out = tensor.shape[0].min(4096);
        let bias = name.replace("weight", "bias");
        let bias = tensors
            .iter_mut()
            .find(|tensor| tensor.name == bias)
            .unwrap();
        (bias.shape, bias.values) = (vec![n_out], vec![0.1; n_out]);
        let problem = problem_of(&tensors);
        assert!(
            problem.contains("a.tar") && problem.contains(expected),
            "{problem}"
        );
    }
    let without = whole()
        .into_iter()
        .filter(|tensor| !tensor.name.starts_with("rgb"));
    let problem = problem_of(&without.collect::<Vec<_>>());
    assert!(problem.contains("rgb_linear.weight: missing"), "{problem}");
    // A shape that says more than there is.
    let mut large = whole();
    large[0].shape = vec![4000, 27];
    large[1] = tensor("pts_linears.0.bias", &[4000], vec![0.0; 4000]);
    let problem = problem_of(&large);
    assert!(problem.contains("exceeds its storage"), "{problem}");
}

#[test]
fn other_checkpoints_are_recognised_and_refused() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = zip_checkpoint("state_dict", &tensors(&small(1)));
    let path = write(folder.path(), "other.pt", &bytes);
    assert!(is_nerf(&path), "a checkpoint");
    let problem = read(&path).err().unwrap().to_string();
    assert!(problem.contains("no radiance field"), "{problem}");
    for bytes in [&b"PK\x03\x04"[..], b"ply\n", b"", b"\x1f\x8b\x08"] {
        assert!(!is_nerf(&write(folder.path(), "x", bytes)), "{bytes:?}");
    }
}

#[test]
fn damaged_checkpoints_are_survived() {
    let tensors = tensors(&small(0));
    let outer = "model_fine_state_dict";
    assert_survives_damage("zip.ckpt", &zip_checkpoint(outer, &tensors));
    assert_survives_damage("legacy.ckpt", &legacy_checkpoint(outer, &tensors));
}
