//! Tests of `radiance_field`.

use super::*;
use crate::neif::test_gradients::{agrees, assert_agrees, dot, random, slope};

fn field() -> RadianceField {
    let grid = GridConfig {
        coarsest: 4,
        finest: 32,
        log2_table_size: 10,
        ..GridConfig::SMALL
    };
    let config = FieldConfig {
        grid,
        n_hidden: 32,
        view_dependent: true,
        integrated: true,
        is_far: false,
    };
    let mut field = RadianceField::new(config, random(7));
    // Grid values of order one, so that the features matter.
    let n_networks = field.n_network_params();
    for (i, value) in field.params[n_networks..].iter_mut().enumerate() {
        *value = (i as f32 * 0.77).sin() * 0.5;
    }
    field
}

fn rays(lobe_variance: f32) -> Vec<FieldRay> {
    let direction = [0.6, 0.48, 0.64];
    let cone = ConeRay {
        origin: [0.1, -0.2, 0.0],
        direction,
        base: 0.002,
        spread: 0.01,
        lobe_variance,
    };
    let lobe = FieldRay {
        cone,
        direction,
        kappa: 50.0,
    };
    let pixel = FieldRay::of_pixel(cone.origin, [-0.6, 0.0, 0.8], cone.base, cone.spread);
    vec![lobe, pixel]
}

/// Runs forward; sample positions depend on the rays' paths only, so they do not move between calls.
fn run(field: &RadianceField, lobe_variance: f32) -> FieldBatch {
    let mut batch = FieldBatch {
        rays: rays(lobe_variance),
        ..FieldBatch::default()
    };
    field.place(&mut batch, &DensityGrid::default(), 8, 0.5, |_| [0.1, -0.2]);
    field.encode(&mut batch, &mut Vec::new());
    field.forward(&mut batch);
    batch
}

const D: [[f32; 3]; 2] = [[0.7, -0.3, 1.1], [0.2, 0.9, -0.5]];

fn loss(field: &RadianceField, lobe_variance: f32) -> f64 {
    let batch = run(field, lobe_variance);
    dot(batch.radiance.as_flattened(), D.as_flattened())
}

/// What a backward pass leaves, and the gradients of the networks.
fn gone_back(field: &RadianceField) -> (FieldBatch, Vec<f32>) {
    let mut batch = run(field, 0.02);
    batch.d_radiance = D.to_vec();
    let mut transposed = Vec::new();
    field.transpose(&mut transposed);
    let mut gradient = vec![0.0; field.n_network_params()];
    field.backward(&transposed, &mut batch, CutOff::default(), &mut gradient);
    (batch, gradient)
}

#[test]
fn gradients_of_all_parameters_agree_with_finite_differences() {
    let mut field = field();
    let n_networks = field.n_network_params();
    let (batch, mut gradient) = gone_back(&field);
    gradient.resize(field.params.len(), 0.0);
    for level in 0..4 {
        let range = field.grid.table(level);
        field.scatter_level(level, &batch, &mut gradient[range]);
    }
    let touched: Vec<usize> = (n_networks..gradient.len())
        .filter(|&i| gradient[i].abs() > 1e-3)
        .step_by(5)
        .collect();
    assert!(touched.len() > 20, "the rays must touch the grid");
    let mut n_off = 0;
    let checked: Vec<usize> = (0..n_networks).step_by(61).chain(touched).collect();
    for &i in &checked {
        let numeric = slope(
            &mut field,
            |field| &mut field.params[i],
            2e-3,
            |field| loss(field, 0.02),
        );
        n_off += usize::from(!agrees(gradient[i], numeric, (3e-2, 2e-3)));
    }
    // A ReLU kink between the two evaluations is allowed now and then.
    assert!(
        n_off * 50 <= checked.len(),
        "{n_off} of {} gradients are off",
        checked.len()
    );
}

#[test]
fn lobe_width_gradient_agrees_with_finite_differences() {
    let field = field();
    let (batch, _) = gone_back(&field);
    // A wider difference meets a ReLU's kink.
    let numeric = (loss(&field, 0.0202) - loss(&field, 0.0198)) / 0.0004;
    assert_agrees("lobe", batch.d_lobe_variance[0], numeric, (3e-2, 0.0));
    assert_eq!(batch.d_lobe_variance[1], 0.0, "a pixel's ray has no lobe");
}
