//! Checkpoints of nerfacto, with either kind of networks.

use super::ngp::harmonics;
use super::*;

const LEVELS: usize = 16;
const FEATURES: usize = 2;
const TABLE: usize = 1 << 9;
const FINEST: f64 = 2048.0;
const LEARNT: usize = 5;

/// A network's matrices `[n_out][n_in]` and biases.
type Layers = Vec<(usize, Vec<f32>, Vec<f32>)>;

fn layers(random: &mut Random, sizes: &[(usize, usize)], bias: f32) -> Layers {
    let layer = |(n_in, n_out): &(usize, usize)| {
        let weights = random.numbers(n_in * n_out, 2.0 / (*n_in as f32).sqrt());
        (*n_in, weights, random.numbers(*n_out, bias))
    };
    sizes.iter().map(layer).collect()
}

fn apply(layers: &Layers, mut x: Vec<f64>) -> Vec<f64> {
    for (i, (n_in, weights, bias)) in layers.iter().enumerate() {
        assert_eq!(*n_in, x.len(), "layer {i} fits");
        let rows = weights.chunks(*n_in).zip(bias);
        let sum = |row: &[f32]| {
            row.iter()
                .zip(&x)
                .map(|(w, x)| f64::from(*w) * x)
                .sum::<f64>()
        };
        let last = i + 1 == layers.len();
        let value = |(row, bias): (&[f32], &f32)| {
            let sum = sum(row) + f64::from(*bias);
            if last { sum } else { sum.max(0.0) }
        };
        x = rows.map(value).collect();
    }
    x
}

/// A field: its networks and its table, and whether they are tiny-cuda-nn's.
struct Small {
    is_tcnn: bool,
    density: Layers,
    color: Layers,
    table: Vec<f32>,
    learnt: Vec<f32>,
}

impl Small {
    fn new(is_tcnn: bool) -> Self {
        let mut random = Random(17);
        let n_color = 16 + 15 + LEARNT;
        let (n_in, n_out, bias) = if is_tcnn {
            (n_color.next_multiple_of(16), 16, 0.0)
        } else {
            (n_color, 3, 0.3)
        };
        let n_corners: usize = if is_tcnn {
            (0..LEVELS).map(|level| Self::tcnn_level(level).2).sum()
        } else {
            LEVELS * TABLE
        };
        Self {
            is_tcnn,
            density: layers(&mut random, &[(LEVELS * FEATURES, 64), (64, 16)], bias),
            color: layers(&mut random, &[(n_in, 64), (64, 64), (64, n_out)], bias),
            table: random.numbers(n_corners * FEATURES, 1.0),
            learnt: random.numbers(3 * LEARNT, 1.0),
        }
    }

    fn growth() -> f64 {
        ((FINEST.ln() - 16_f64.ln()) / (LEVELS as f64 - 1.0)).exp()
    }

    /// Cells along a side, corners along a side, and places in the table.
    fn tcnn_level(level: usize) -> (f64, usize, usize) {
        let scale = 16.0 * Self::growth().powi(level as i32) - 1.0;
        // Those of the finest level may be one more, which is all the same to a hash.
        let side = (scale - 1e-3).ceil() as usize + 1;
        (scale, side, (side.pow(3).div_ceil(8) * 8).min(TABLE))
    }

    fn tensors(&self) -> Vec<TestTensor> {
        let name = |name: &str| format!("_model.field.{name}");
        let embedding = name("embedding_appearance.embedding.weight");
        let scalar = |key: &str, value: f32| tensor(&name(key), &[], vec![value]);
        let mut tensors = vec![
            tensor(&embedding, &[3, LEARNT], self.learnt.clone()),
            scalar("log2_hashmap_size", TABLE.ilog2() as f32),
            scalar("max_res", FINEST as f32),
            scalar("num_levels", LEVELS as f32),
        ];
        if self.is_tcnn {
            let flat = |layers: &Layers| -> Vec<f32> {
                layers
                    .iter()
                    .flat_map(|(_, weights, _)| weights.clone())
                    .collect()
            };
            let mut base = flat(&self.density);
            base.extend(&self.table);
            let head = flat(&self.color);
            tensors.push(tensor(&name("mlp_base.model.params"), &[base.len()], base));
            tensors.push(tensor(
                &name("mlp_head.tcnn_encoding.params"),
                &[head.len()],
                head,
            ));
            return tensors;
        }
        let table = name("mlp_base.model.0.hash_table");
        tensors.push(tensor(
            &table,
            &[LEVELS * TABLE, FEATURES],
            self.table.clone(),
        ));
        for (list, layers) in [
            ("mlp_base.model.1", &self.density),
            ("mlp_head", &self.color),
        ] {
            for (i, (n_in, weights, bias)) in layers.iter().enumerate() {
                let layer = name(&format!("{list}.layers.{i}"));
                let shape = [bias.len(), *n_in];
                tensors.push(tensor(&format!("{layer}.weight"), &shape, weights.clone()));
                tensors.push(tensor(
                    &format!("{layer}.bias"),
                    &[bias.len()],
                    bias.clone(),
                ));
            }
        }
        tensors
    }

    fn features(&self, p: [f64; 3]) -> Vec<f64> {
        let (mut out, mut first) = (Vec::new(), 0);
        for level in 0..LEVELS {
            let (scale, side, n, shift) = if self.is_tcnn {
                let (scale, side, n) = Self::tcnn_level(level);
                (scale, side, n, 0.5)
            } else {
                // The finest is 2047 in single precision.
                let scale = (16.0 * Self::growth().powi(level as i32) - 1e-3).floor();
                (
                    if level == 0 { 16.0 } else { scale },
                    usize::MAX,
                    TABLE,
                    0.0,
                )
            };
            let at = p.map(|x| x * scale + shift);
            let mut sums = [0.0; FEATURES];
            for corner in 0..8 {
                let up = [corner & 1, corner >> 1 & 1, corner >> 2];
                let (mut weight, mut c) = (1.0, [0_usize; 3]);
                for k in 0..3 {
                    let to = at[k] - at[k].floor();
                    weight *= if up[k] == 1 { to } else { 1.0 - to };
                    c[k] = at[k].floor() as usize + up[k];
                }
                let is_dense = side.checked_pow(3).is_some_and(|all| all <= n);
                let index = if is_dense {
                    c[0] + side * (c[1] + side * c[2])
                } else {
                    c[0] ^ (c[1] * 2_654_435_761) ^ (c[2] * 805_459_861)
                };
                let corner = (first + index % n) * FEATURES;
                for (sum, x) in sums.iter_mut().zip(&self.table[corner..]) {
                    *sum += weight * f64::from(*x);
                }
            }
            out.extend(sums);
            first += n;
        }
        out
    }

    /// In the field's own coordinates.
    fn answer(&self, p: [f64; 3], d: [f64; 3], density_scale: f64) -> (f64, [f64; 3]) {
        let norm = p.iter().fold(0.0_f64, |norm, x| norm.max(x.abs()));
        let q = p.map(|x| {
            if norm < 1.0 {
                x
            } else {
                (2.0 - 1.0 / norm) * x / norm
            }
        });
        let first = apply(&self.density, self.features(q.map(|x| (x + 2.0) / 4.0)));
        let mut x = if self.is_tcnn {
            harmonics(d)
        } else {
            // Without the phase, and of the direction squeezed into half.
            let halved = harmonics(d.map(|x| 0.5 * x + 0.5)).into_iter().enumerate();
            let sign = |i: usize| if i.is_multiple_of(2) { 1.0 } else { -1.0 };
            halved.map(|(i, y)| sign(i) * y).collect()
        };
        x.extend(&first[1..]);
        let mean = |k: usize| {
            (0..3)
                .map(|i| f64::from(self.learnt[i * LEARNT + k]))
                .sum::<f64>()
                / 3.0
        };
        x.extend((0..LEARNT).map(mean));
        x.resize(self.color[0].0, 1.0);
        let color = apply(&self.color, x);
        let color = [0, 1, 2].map(|c| 1.0 / (1.0 + (-color[c]).exp()));
        (density_scale * first[0].exp(), color)
    }
}

const CONFIG: &str = "\
pipeline: !!python/object:nerfstudio.pipelines.base_pipeline.VanillaPipelineConfig
  model: !!python/object:nerfstudio.models.nerfacto.NerfactoModelConfig
    average_init_density: 0.5
    base_res: 16
    proposal_net_args_list:
    - hidden_dim: 16
      max_res: 128
    max_res: 4096
  other:
    average_init_density: 0.25
";

#[test]
fn both_kinds_of_networks_answer_as_nerfstudio_does() {
    for is_tcnn in [true, false] {
        let small = Small::new(is_tcnn);
        let folder = tempfile::tempdir().unwrap();
        let bytes = zip_checkpoint("pipeline", &small.tensors());
        let nerf = read(&write(folder.path(), "step-1.ckpt", &bytes)).unwrap();
        let wide = |v: Vec3| v.to_array().map(f64::from);
        // Far out and near; alone, the density is the method's.
        for reach in [0.9, 8.0] {
            assert_answers(&nerf, reach, |p, d| small.answer(wide(p), wide(d), 0.01));
        }
    }
}

#[test]
fn the_folder_of_the_run_says_where_the_scene_is() {
    let small = Small::new(true);
    let folder = tempfile::tempdir().unwrap();
    let models = folder.path().join("nerfstudio_models");
    std::fs::create_dir(&models).unwrap();
    let path = write(
        &models,
        "step-1.ckpt",
        &zip_checkpoint("pipeline", &small.tensors()),
    );
    let transform =
        "{\"transform\": [[0, 0, 1, 0.5], [1, 0, 0, 0], [0, 1, 0, -0.25]], \"scale\": 0.5}";
    write(
        folder.path(),
        "dataparser_transforms.json",
        transform.as_bytes(),
    );
    write(folder.path(), "config.yml", CONFIG.as_bytes());
    let nerf = read(&path).unwrap();
    assert_answers(&nerf, 1.5, |p, d| {
        let at = [p.z + 0.5, p.x, p.y - 0.25].map(|x| 0.5 * f64::from(x));
        let (density, color) = small.answer(at, [d.z, d.x, d.y].map(f64::from), 0.5);
        (0.5 * density, color)
    });
    for (text, expected) in [
        ("{}", "missing field"),
        (
            "{\"transform\": [[0,0,2,0],[1,0,0,0],[0,1,0,0]], \"scale\": 1}",
            "not a turn",
        ),
        (
            "{\"transform\": [[0,0,1,0],[1,0,0,0],[0,1,0,0]], \"scale\": 0}",
            "scale",
        ),
    ] {
        write(folder.path(), "dataparser_transforms.json", text.as_bytes());
        let problem = read(&path).err().unwrap().to_string();
        assert!(problem.contains("dataparser_transforms.json"), "{problem}");
        assert!(problem.contains(expected), "{problem}");
    }
}

#[test]
fn checkpoints_that_do_not_fit_say_why() {
    let folder = tempfile::tempdir().unwrap();
    for (is_tcnn, name, expected) in [
        (
            true,
            "mlp_base.model.params",
            "mlp_base: 100 numbers are those of no grid",
        ),
        (
            true,
            "mlp_head.tcnn_encoding.params",
            "mlp_head.tcnn_encoding.params: 100 numbers",
        ),
        (
            false,
            "mlp_base.model.0.hash_table",
            "hash_table: no matrix",
        ),
        (false, "mlp_head.layers.1.weight", "mlp_head"),
    ] {
        let mut tensors = Small::new(is_tcnn).tensors();
        let full = format!("_model.field.{name}");
        let at = tensors
            .iter()
            .position(|tensor| tensor.name == full)
            .unwrap();
        tensors[at] = tensor(&full, &[100], vec![0.0; 100]);
        let bytes = zip_checkpoint("pipeline", &tensors);
        let problem = read(&write(folder.path(), "a.ckpt", &bytes))
            .err()
            .unwrap()
            .to_string();
        assert!(
            problem.contains("a.ckpt") && problem.contains(expected),
            "{problem}"
        );
    }
}

#[test]
fn damaged_checkpoints_of_nerfacto_are_survived() {
    let bytes = zip_checkpoint("pipeline", &Small::new(false).tensors());
    assert_survives_damage("a.ckpt", &bytes);
}
