// A multi-resolution hash grid: trilinear features of a point in the unit cube, four a level (`neif/networks/hash_grid.rs`).
// instant-ngp, Eq. 4 of arXiv:2201.05989; level weights after Zip-NeRF, Sec. 3.1 of arXiv:2304.06706.
//
// A pattern that is made twice: NAME stands for the field, LEVELS for its number of levels, BINDING for its place.

// Rows of four half-precision values, level after level.
@group(0) @binding(BINDING) var<storage, read> NAME_grid: array<vec2<u32>>;

// Weighted features of a level; `footprint` is the standard deviation in cube sides.
fn NAME_level(number: u32, at: vec3<f32>, footprint: f32) -> vec4<f32> {
    let level = frame.NAME_levels[number];
    let n_cells = f32(level.x);
    let k = FOOTPRINT_SLOPE * footprint * n_cells;
    let level_weight = inverseSqrt(1.0 + k * k);
    if level_weight < NAME_LEAST_WEIGHT {
        return vec4(0.0);
    }
    let scaled = clamp(at * n_cells, vec3(0.0), vec3(n_cells));
    // The far rim belongs to the last cell.
    let cell = vec3<u32>(floor(min(scaled, vec3(n_cells - 0.5))));
    let inside = scaled - vec3<f32>(cell);
    let is_dense = level.z == 0u;
    let side = level.x + 1u;
    let strides = select(vec3(1u, 2654435761u, 805459861u), vec3(1u, side, side * side), is_dense);
    var sum = vec4(0.0);
    for (var corner = 0u; corner < 8u; corner++) {
        let upper = vec3(corner & 1u, (corner >> 1u) & 1u, corner >> 2u);
        let term = (cell + upper) * strides;
        let index = select((term.x ^ term.y ^ term.z) & level.z, term.x + term.y + term.z, is_dense);
        let row = NAME_grid[level.y + index];
        let sides = select(1.0 - inside, inside, upper == vec3(1u));
        sum += sides.x * sides.y * sides.z * vec4(unpack2x16float(row.x), unpack2x16float(row.y));
    }
    return sum * level_weight;
}
