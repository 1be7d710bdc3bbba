// Where along a ray the samples go: the inverse distribution of weights composited from the cached density
// (`neif/field/proposal.rs`, `neif/field/density_grid.rs`), and the contraction of far space (`neif/field/contraction.rs`, Eq. 10 of arXiv:2111.12077).

const OUTER_SIDE: f32 = 96.0;
const INNER_SIDE: f32 = 128.0;
const INNER_CELLS: u32 = 2097152u;
const INNER_STEPS: u32 = 48u;
const OUTER_STEPS: u32 = 32u;
const N_STEPS: u32 = 80u;
// Where the last step ends, in half sides of the inner box beyond it.
const REACH: f32 = 48.0;
const UNIFORM_SHARE: f32 = 0.05;

// Two cells of the running mean of the density a word, in bf16; 0 is empty for good. Then the floor: its normal and the
// offset along it, a normal of 0 where there is none (`neif/field/floor.rs`).
@group(0) @binding(3) var<storage, read> density_cells: array<u32>;

// The first word after the cells.
const FLOOR: u32 = 1490944u;
// The least slope of a ray that meets the floor.
const LEAST_SLOPE: f32 = 1e-3;
const NO_FLOOR: f32 = 1e30;

// As `FieldRay`: field coordinates.
struct FieldRay {
    origin: vec3<f32>,
    // Standard deviation of the footprint at the origin.
    base: f32,
    // Unit.
    direction: vec3<f32>,
    // Growth of the footprint with distance.
    spread: f32,
    // Length of the mean direction of the lobe, variance of its directions, concentration (NO_LOBE for a pixel's ray).
    mean_length: f32,
    lobe_variance: f32,
    kappa: f32,
    unused: f32,
}

const NO_LOBE: f32 = 1e30;

fn ray_at(ray: FieldRay, t: f32) -> vec3<f32> {
    return ray.origin + (t * ray.mean_length) * ray.direction;
}

fn max_abs(x: vec3<f32>) -> f32 {
    return max(max(abs(x.x), abs(x.y)), abs(x.z));
}

fn cell_of(unit: vec3<f32>, side: f32) -> u32 {
    let cell = vec3<u32>(clamp(unit * side, vec3(0.0), vec3(side - 0.5)));
    return cell.x + (cell.y + cell.z * u32(side)) * u32(side);
}

fn inner_cell(x: vec3<f32>) -> u32 {
    return cell_of(x * 0.5 + 0.5, INNER_SIDE);
}

// A point contracted into the cube from -2 to 2, and the local scale of lengths there.
fn contract(x: vec3<f32>) -> vec4<f32> {
    let inverse = 1.0 / max(max_abs(x), 1.0);
    let scale = (2.0 - inverse) * inverse;
    let root = pow(scale * inverse, 2.0 / 3.0);
    return vec4(x * scale, select(1.0, root, inverse < 1.0));
}

fn outer_cell(contracted: vec3<f32>) -> u32 {
    return INNER_CELLS + cell_of(contracted * 0.25 + 0.5, OUTER_SIDE);
}

fn cell_index(x: vec3<f32>) -> u32 {
    if max_abs(x) < 1.0 {
        return inner_cell(x);
    }
    return outer_cell(contract(x).xyz);
}

fn cached_density(cell: u32) -> f32 {
    let pair = density_cells[cell >> 1u];
    return bitcast<f32>(select(pair << 16u, pair & 0xffff0000u, (cell & 1u) == 1u));
}

// Distance along a ray from above to the floor, NO_FLOOR where it meets none.
fn floor_distance(ray: FieldRay) -> f32 {
    let numbers = vec4<u32>(
        density_cells[FLOOR],
        density_cells[FLOOR + 1u],
        density_cells[FLOOR + 2u],
        density_cells[FLOOR + 3u],
    );
    let plane = bitcast<vec4<f32>>(numbers);
    let height = dot(ray.origin, plane.xyz) - plane.w;
    let slope = -dot(ray.direction, plane.xyz) * ray.mean_length;
    return select(NO_FLOOR, height / max(slope, LEAST_SLOPE), height > 0.0 && slope > LEAST_SLOPE);
}

// Distance where the ray leaves the inner box, or where it is about as far as the box when it misses it.
fn split_distance(ray: FieldRay) -> f32 {
    let along = ray.direction * ray.mean_length;
    var near = 0.0;
    var far = 1e30;
    for (var axis = 0u; axis < 3u; axis++) {
        let least = select(-1e-20, 1e-20, along[axis] >= 0.0);
        let d = select(along[axis], least, abs(along[axis]) < 1e-20);
        let a = (-1.0 - ray.origin[axis]) / d;
        let b = (1.0 - ray.origin[axis]) / d;
        near = max(near, min(a, b));
        far = min(far, max(a, b));
    }
    if far > near && far < 1e15 {
        return max(far, 0.05);
    }
    return max(max_abs(ray.origin), 0.5);
}

fn outer_distance(step: f32, split: f32) -> f32 {
    let u = (step - f32(INNER_STEPS)) * (REACH / (REACH + 1.0) / f32(OUTER_STEPS));
    return split + u / (1.0 - u);
}

fn step_distance(step: f32, split: f32) -> f32 {
    if step <= f32(INNER_STEPS) {
        return step * (split / f32(INNER_STEPS));
    }
    return outer_distance(step, split);
}

// The fractional step at a distance; N_STEPS from where the steps end.
fn step_at(distance: f32, split: f32) -> f32 {
    let beyond = distance - split;
    if beyond <= 0.0 {
        return distance / (split / f32(INNER_STEPS));
    }
    let u = beyond / (1.0 + beyond);
    return min(f32(INNER_STEPS) + u / (REACH / (REACH + 1.0) / f32(OUTER_STEPS)), f32(N_STEPS));
}

// Weights of all steps, composited front to back from the cached density.
fn march(ray: FieldRay, split: f32, weights: ptr<function, array<f32, N_STEPS>>) {
    var transmittance = 1.0;
    for (var step = 0u; step < N_STEPS; step++) {
        var length = split / f32(INNER_STEPS);
        var cell = 0u;
        if step < INNER_STEPS {
            cell = inner_cell(ray_at(ray, (f32(step) + 0.5) * length));
        } else {
            let near = outer_distance(f32(step), split);
            let far = outer_distance(f32(step) + 1.0, split);
            length = far - near;
            cell = outer_cell(contract(ray_at(ray, 0.5 * (near + far))).xyz);
        }
        let alpha = 1.0 - exp(-min(cached_density(cell) * length, 87.0));
        (*weights)[step] = alpha * transmittance;
        transmittance -= alpha * transmittance;
    }
}

// The share of a step that lies before the fractional step `end`.
fn part(step: u32, end: f32) -> f32 {
    return clamp(end - f32(step), 0.0, 1.0);
}

// The greatest of a weight and its neighbours, plus the uniform share, as far as the step lies before `end`.
fn spread_weight(weights: ptr<function, array<f32, N_STEPS>>, i: u32, end: f32) -> f32 {
    let before = (*weights)[max(i, 1u) - 1u];
    let after = (*weights)[min(i + 1u, N_STEPS - 1u)];
    return (max(max((*weights)[i], before), after) + UNIFORM_SHARE / f32(N_STEPS)) * part(i, end);
}
