// The picture: light gathered along the paths (`neif/light/light_path.rs`), object over background by coverage in linear
// light, then the display transform (`render/path/shade.rs`, `neif/light/display.rs`).

// One RGBA8 word a pixel of the whole picture.
@group(0) @binding(15) var<storage, read_write> picture: array<u32>;

// What a ray brought, with the gain of the environment.
fn incoming(ray: u32) -> vec3<f32> {
    if ray == NONE {
        return vec3(0.0);
    }
    return radiance[ray].xyz * frame.motion.xyz;
}

// What the first vertex of a path sends to the eye, by the pixel equation (Eq. 7).
fn gather(path: u32) -> vec3<f32> {
    let first = path * LIT_ROWS;
    var last = 0u;
    while last < 3u && (lit[first + 2u * last + 1u].w & GOES_ON) != 0u {
        last++;
    }
    var beyond = vec3(0.0);
    for (var i = last + 1u; i > 0u; i--) {
        let k = i - 1u;
        let own = bitcast<vec4<f32>>(lit[first + 2u * k]);
        let row = lit[first + 2u * k + 1u];
        let factor = bitcast<vec3<f32>>(row.xyz);
        let free = incoming(row.w & NONE);
        let light = free * (1.0 - own.w) + beyond * own.w;
        let shows_own = k > 0u || frame.flags.z != LAYER_SPECULAR;
        let shows_light = k > 0u || frame.flags.z != LAYER_DIFFUSE;
        beyond = select(vec3(0.0), own.xyz, shows_own) + select(vec3(0.0), factor * light, shows_light);
    }
    return beyond;
}

fn srgb_from_linear(linear: f32) -> f32 {
    if linear <= 0.0031308 {
        return 12.92 * linear;
    }
    return 1.055 * pow(linear, 1.0 / 2.4) - 0.055;
}

fn display(linear: f32) -> f32 {
    // The brightest light there is stays finite.
    let srgb = srgb_from_linear(clamp(linear, 0.0, 1e12));
    return select(0.0, min(pow(max(srgb, 1e-12), frame.specular.w), 1.0), srgb > 0.0);
}

// Khronos PBR Neutral (`render/output/tone_map.rs`).
fn neutral(given: vec3<f32>) -> vec3<f32> {
    let light = clamp(given, vec3(0.0), vec3(1e6));
    let least = min(light.x, min(light.y, light.z));
    let color = light - select(0.04, least - 6.25 * least * least, least < 0.08);
    let peak = max(color.x, max(color.y, color.z));
    let start = 0.76;
    if peak < start {
        return color;
    }
    let room = 1.0 - start;
    let new_peak = 1.0 - room * room / (peak + room - start);
    let white = 1.0 - 1.0 / (0.15 * (peak - new_peak) + 1.0);
    return mix(color * new_peak / peak, vec3(new_peak), white);
}

@compute @workgroup_size(64)
fn compose(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = thread_index(id, groups);
    if i >= frame.size.x * frame.size.w {
        return;
    }
    let pixel = pixels[i];
    var object = vec3(0.0);
    for (var k = 0u; k < pixel.n_paths; k++) {
        object += gather(pixel.first_path + k);
    }
    object /= f32(max(pixel.n_paths, 1u));
    let mixed = object * pixel.coverage + incoming(pixel.ray) * (1.0 - pixel.coverage);
    let exposed = mixed * frame.diffuse.w;
    let shown = select(exposed, neutral(exposed), frame.flags.w != 0u);
    let color = vec3(display(shown.x), display(shown.y), display(shown.z));
    let bytes = vec3<u32>(color * 255.0 + 0.5);
    picture[frame.size.z * frame.size.x + i] = bytes.x | (bytes.y << 8u) | (bytes.z << 16u) | 0xff000000u;
}
