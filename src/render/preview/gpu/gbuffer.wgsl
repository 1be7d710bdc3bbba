// Which pixels the object covers, and the points from which its light paths start: `render/gbuffer.rs`.

// Sub-samples per axis of a silhouette pixel.
const SUBSAMPLES: u32 = 4u;
// Cosine of the turn of the mirror direction to the next pixel above which a pixel is sampled by squares.
const LEAST_COS: f32 = 0.9689124;

// Where a path starts.
struct PathStart {
    at: SurfacePoint,
    // Turn of the rings of lobe rays, radians; below 0 where there is no path.
    turn: f32,
    unused_a: f32,
    unused_b: f32,
    unused_c: f32,
}

// What is known of a pixel of the band.
struct Pixel {
    coverage: f32,
    first_path: u32,
    n_paths: u32,
    // The ray of what is behind the object, or NONE.
    ray: u32,
}

// What the rays through the pixels' centres met: the band's rows and one more on each side.
@group(0) @binding(8) var<storage, read_write> centers: array<SurfacePoint>;
@group(0) @binding(10) var<storage, read_write> starts: array<PathStart>;
@group(0) @binding(14) var<storage, read_write> pixels: array<Pixel>;

@compute @workgroup_size(64)
fn trace_centers(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = thread_index(id, groups);
    let width = frame.size.x;
    if i >= width * (frame.size.w + 2u) {
        return;
    }
    // The first row lies above the band, perhaps above the picture.
    let y = f32(frame.size.z) + f32(i / width) - 0.5;
    centers[i] = trace_pixel(vec2(f32(i % width) + 0.5, y), 1.0);
}

@compute @workgroup_size(64)
fn start_paths(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = thread_index(id, groups);
    let width = frame.size.x;
    if i >= width * frame.size.w {
        return;
    }
    let place = vec2(i % width, frame.size.z + i / width);
    var pixel = Pixel(0.0, 0u, 0u, NONE);
    if frame.flags.z != LAYER_ENVIRONMENT {
        let at = i + width;
        let x = i % width;
        let beside = array<u32, 4>(at - width, at + width, at - select(0u, 1u, x > 0u), at + select(0u, 1u, x + 1u < width));
        let center = centers[at];
        var is_edge = false;
        var is_discontinuous = false;
        for (var k = 0u; k < 4u; k++) {
            let other = centers[beside[k]];
            is_edge |= other.is_seen != center.is_seen;
            is_discontinuous |= dot(reflected(center), reflected(other)) <= LEAST_COS;
        }
        if is_edge {
            pixel = edge_paths(place, max(frame.options.y, 2u));
        } else if center.is_seen > 0.0 {
            let n = select(frame.options.x, frame.options.y, is_discontinuous);
            pixel = inner_paths(place, n, center);
        }
    }
    if frame.flags.y != BEHIND_NOTHING && pixel.coverage < 1.0 {
        pixel.ray = push_background_ray(vec2<f32>(place) + 0.5);
    }
    pixels[i] = pixel;
}

// A turn that varies from pixel to pixel spreads the few lobe rays (golden angle).
fn turn_of(place: vec2<u32>, path: u32) -> f32 {
    let number = (place.y * frame.size.x + place.x) % 4096u;
    let turn = f32(number) * 2.399963 + f32(path);
    // Sines of large angles are imprecise.
    return turn - floor(turn / TAU) * TAU;
}

// The points seen through `n` by `n` squares of a pixel that the object covers.
fn inner_paths(place: vec2<u32>, n: u32, center: SurfacePoint) -> Pixel {
    let first = atomicAdd(&counters.n_paths, n * n);
    if n == 1u {
        starts[first] = PathStart(center, turn_of(place, 0u), 0.0, 0.0, 0.0);
        return Pixel(1.0, first, 1u, NONE);
    }
    let side = 1.0 / f32(n);
    var count = 0u;
    for (var k = 0u; k < n * n; k++) {
        let at = vec2<f32>(place) + (vec2(f32(k % n), f32(k / n)) + 0.5) * side;
        let point = trace_pixel(at, side);
        if point.is_seen > 0.0 {
            starts[first + count] = PathStart(point, turn_of(place, count), 0.0, 0.0, 0.0);
            count++;
        }
    }
    clear_paths(first + count, first + n * n);
    return Pixel(1.0, first, count, NONE);
}

// In each of `n` by `n` squares of a pixel on the silhouette the hit nearest to the covered part's centre.
fn edge_paths(place: vec2<u32>, n: u32) -> Pixel {
    let first = atomicAdd(&counters.n_paths, n * n);
    let n_inside = SUBSAMPLES / n;
    var count = 0u;
    var n_hits = 0u;
    for (var square = 0u; square < n * n; square++) {
        let corner_of_square = vec2(square % n, square / n) * n_inside;
        var hits = 0u;
        var mean = vec2(0.0);
        var n_here = 0.0;
        for (var k = 0u; k < n_inside * n_inside; k++) {
            let at = subsample_at(place, corner_of_square, k, n_inside);
            if intersect(camera_ray(at)).is_hit {
                hits |= 1u << k;
                mean += at;
                n_here += 1.0;
            }
        }
        if hits == 0u {
            continue;
        }
        n_hits += countOneBits(hits);
        mean /= n_here;
        var nearest = vec2(0.0);
        var least = 1e30;
        for (var k = 0u; k < n_inside * n_inside; k++) {
            let at = subsample_at(place, corner_of_square, k, n_inside);
            let off = dot(at - mean, at - mean);
            if (hits & (1u << k)) != 0u && off < least - 1e-5 {
                least = off;
                nearest = at;
            }
        }
        let point = trace_pixel(nearest, 1.0 / f32(n));
        if point.is_seen > 0.0 {
            starts[first + count] = PathStart(point, turn_of(place, count), 0.0, 0.0, 0.0);
            count++;
        }
    }
    clear_paths(first + count, first + n * n);
    return Pixel(f32(n_hits) / f32(SUBSAMPLES * SUBSAMPLES), first, count, NONE);
}

fn subsample_at(place: vec2<u32>, corner_of_square: vec2<u32>, k: u32, n_inside: u32) -> vec2<f32> {
    let offset = vec2<f32>(corner_of_square + vec2(k % n_inside, k / n_inside)) + 0.5;
    return vec2<f32>(place) + offset / f32(SUBSAMPLES);
}

fn clear_paths(first: u32, end: u32) {
    for (var path = first; path < end; path++) {
        starts[path].turn = -1.0;
    }
}
