// The surface field M(x) and the edit of the whole object: `neif/surface/material.rs`, `neif/surface/edit.rs`.

const DIFFUSE_SHIFT: f32 = -2.0;
const ROUGHNESS_SHIFT: f32 = -0.85;
const ROUGHNESS_MIN: f32 = 0.02;

struct Surface {
    diffuse: vec3<f32>,
    // As it was learned.
    roughness: f32,
    tint: vec3<f32>,
}

fn sigmoid(x: vec4<f32>) -> vec4<f32> {
    return 1.0 / (1.0 + exp(-clamp(x, vec4(-87.0), vec4(87.0))));
}

fn softplus(x: vec3<f32>) -> vec3<f32> {
    return max(x, vec3(0.0)) + log(1.0 + exp(-abs(x)));
}

// The surface at a world point, its diffuse part edited and in the light of now.
fn surface_at(position: vec3<f32>) -> Surface {
    let at = (position - frame.material_cube.xyz) / frame.material_cube.w;
    var features: array<vec4<f32>, MATERIAL_LEVELS>;
    for (var level = 0u; level < MATERIAL_LEVELS; level++) {
        features[level] = material_level(level, at, 0.0);
    }
    let row = material_network(&features);
    let shares = sigmoid(vec4(row[0].w, row[1].xy, row[1].z + ROUGHNESS_SHIFT));
    var surface: Surface;
    surface.diffuse = softplus(row[0].xyz + DIFFUSE_SHIFT) * frame.diffuse.xyz;
    surface.tint = select(shares.xxx, shares.xyz, HAS_RGB_TINT);
    surface.roughness = ROUGHNESS_MIN + (1.0 - ROUGHNESS_MIN) * shares.w;
    return surface;
}
