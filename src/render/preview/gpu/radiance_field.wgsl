// Linear radiance along the rays of a band: samples placed, encoded, composited as features, and one colour network a
// ray (`neif/field/radiance_field.rs`, `neif/field/composite.rs`; Eq. 1 and 3 of the paper).

const LOBE_START: f32 = 0.006;
const LOG_RADIANCE_MAX: f32 = 12.0;
const LOG_DENSITY_MAX: f32 = 15.0;
// What is left of a ray's light behind something opaque: less than the display shows of it.
const LEAST_TRANSMITTANCE: f32 = 1e-5;

@group(0) @binding(11) var<storage, read_write> rays: array<FieldRay>;
@group(0) @binding(12) var<storage, read_write> radiance: array<vec4<f32>>;

// The row of the density network at a point with its footprint: logarithm of the density, then 15 features.
fn density_row(at: vec3<f32>, footprint: f32) -> array<vec4<f32>, 4> {
    var features: array<vec4<f32>, ENVIRONMENT_LEVELS>;
    for (var level = 0u; level < ENVIRONMENT_LEVELS; level++) {
        features[level] = environment_level(level, at, footprint);
    }
    return density_network(&features);
}

// The ray as the field takes it: a far environment knows no place, and fields without integrated lobes no width.
fn prepared(given: FieldRay) -> FieldRay {
    var ray = given;
    if IS_FAR {
        ray.origin = vec3(0.0);
        ray.base = 0.0;
    }
    if !IS_INTEGRATED && ray.kappa < NO_LOBE {
        ray.base = 0.0;
        ray.spread = 0.0;
        ray.lobe_variance = 0.0;
    }
    return ray;
}

// The 15 features composited along a ray, then its opacity.
fn composited(ray: FieldRay) -> array<vec4<f32>, 4> {
    let n_samples = frame.options.w;
    let split = split_distance(ray);
    var weights: array<f32, N_STEPS>;
    march(ray, split, &weights);
    // The last sample of a ray that ends on the floor is there.
    let to_floor = floor_distance(ray);
    let ends_on_floor = to_floor < NO_FLOOR;
    let end = select(f32(N_STEPS), step_at(to_floor, split), ends_on_floor);
    let n_intervals = select(n_samples, n_samples - 1u, ends_on_floor);
    var total = 0.0;
    for (var i = 0u; i < N_STEPS; i++) {
        total += spread_weight(&weights, i, end);
    }
    let start = select(0.0, LOBE_START, ray.kappa < NO_LOBE && !IS_FAR);
    var sum: array<vec4<f32>, 4>;
    var opacity = 0.0;
    var transmittance = 1.0;
    var below = 0.0;
    var step = 0u;
    var step_weight = spread_weight(&weights, 0u, end);
    var edge = 0.0;
    for (var k = 1u; k <= n_samples; k++) {
        let from_edge = edge;
        let is_floor = k > n_intervals;
        if k == n_intervals {
            edge = step_distance(end, split);
        } else if k < n_intervals {
            // The distribution is cut at equal quantiles.
            let goal = total * f32(k) / f32(n_intervals);
            while step < N_STEPS - 1u && below + step_weight < goal {
                below += step_weight;
                step++;
                step_weight = spread_weight(&weights, step, end);
            }
            let fraction = clamp((goal - below) / max(step_weight, 1e-20), 0.0, 1.0);
            edge = step_distance(f32(step) + fraction * part(step, end), split);
        }
        let delta = edge - from_edge;
        // The last interval reaches far out: its sample is where its near half lies.
        let t = from_edge + min(delta, 1.0) * 0.5;
        let x = ray_at(ray, t);
        // A lobe's ray must not find its light on the surface it starts from, nor inside the object.
        if !is_floor && (t < start || cached_density(cell_index(x)) == 0.0) {
            continue;
        }
        let place = contract(x);
        let beam = ray.base + ray.spread * t;
        let deviation = sqrt(beam * beam + ray.lobe_variance * t * t);
        let row = density_row(place.xyz * 0.25 + 0.5, deviation * place.w * 0.25);
        let depth = exp(min(row[0].x, LOG_DENSITY_MAX)) * delta;
        let alpha = select(1.0 - exp(-min(depth, 87.0)), 1.0, is_floor);
        let weight = alpha * transmittance;
        transmittance -= weight;
        opacity += weight;
        for (var i = 0u; i < 4u; i++) {
            sum[i] += weight * row[i];
        }
        if transmittance < LEAST_TRANSMITTANCE {
            break;
        }
    }
    // Column 0 held the log density.
    return array<vec4<f32>, 4>(
        vec4(sum[0].yzw, sum[1].x),
        vec4(sum[1].yzw, sum[2].x),
        vec4(sum[2].yzw, sum[3].x),
        vec4(sum[3].yzw, min(opacity, 1.0)),
    );
}

fn radiance_along(given: FieldRay) -> vec3<f32> {
    let ray = prepared(given);
    let features = composited(ray);
    var input: array<vec4<f32>, 8>;
    for (var i = 0u; i < 4u; i++) {
        input[i] = features[i];
    }
    if IS_VIEW_DEPENDENT {
        // Spherical harmonics attenuated by the lobe: Eq. 8 of Ref-NeRF, arXiv:2112.03907.
        let d = ray.direction;
        let first = exp(-1.0 / ray.kappa);
        let second = first * first * first;
        input[4] = vec4(0.2820948, 0.4886025 * first * d.yzx);
        input[5] = second * vec4(
            1.0925484 * d.x * d.y,
            1.0925484 * d.y * d.z,
            0.31539157 * (3.0 * d.z * d.z - 1.0),
            1.0925484 * d.x * d.z,
        );
        input[6] = vec4(second * 0.5462742 * (d.x * d.x - d.y * d.y), 0.0, 0.0, 0.0);
    }
    let output = color_network(&input);
    return exp(clamp(output[0].xyz, vec3(-LOG_RADIANCE_MAX), vec3(LOG_RADIANCE_MAX)));
}

@compute @workgroup_size(64)
fn light(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = thread_index(id, groups);
    if i >= atomicLoad(&counters.n_rays) {
        return;
    }
    radiance[i] = vec4(radiance_along(rays[i]), 0.0);
}
