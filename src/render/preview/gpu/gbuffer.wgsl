// Which pixels the object covers, and the points from which its light paths start: `render/path/gbuffer.rs`.

// Sub-samples per axis of a silhouette pixel.
const SUBSAMPLES: u32 = 4u;

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
    centers[i] = trace_beam(vec2(f32(i % width) + 0.5, y), vec2(1.0, 0.0), vec2(0.0, 1.0));
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
        for (var k = 0u; k < 4u; k++) {
            is_edge |= centers[beside[k]].is_seen != center.is_seen;
        }
        if is_edge {
            pixel = edge_paths(place, select(2u, 4u, frame.options.y >= 16u));
        } else if center.is_seen > 0.0 {
            pixel = inner_paths(place, center, turn_at(at, beside));
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

// How the mirror direction turns from a pixel to its neighbours: the direction in which it does fastest, and by how much a
// pixel along that and across it.
struct Turn {
    axis: vec2<f32>,
    by: vec2<f32>,
}

// From the larger of the differences to either side along x and along y.
fn turn_at(at: u32, beside: array<u32, 4>) -> Turn {
    let center = reflected(centers[at]);
    let above = reflected(centers[beside[0]]) - center;
    let below = reflected(centers[beside[1]]) - center;
    let left = reflected(centers[beside[2]]) - center;
    let right = reflected(centers[beside[3]]) - center;
    let dx = select(right, -left, dot(right, right) < dot(left, left));
    let dy = select(below, -above, dot(below, below) < dot(above, above));
    let xx = dot(dx, dx);
    let xy = dot(dx, dy);
    let yy = dot(dy, dy);
    let mean = 0.5 * (xx + yy);
    let apart = length(vec2(0.5 * (xx - yy), xy));
    // `atan2(0, 0)` is not defined here.
    let angle = select(0.0, 0.5 * atan2(2.0 * xy, xx - yy), apart > 0.0);
    return Turn(vec2(cos(angle), sin(angle)), sqrt(vec2(mean + apart, max(mean - apart, 0.0))));
}

// Paths along the axis and across it: halves of what is widest until it is narrow enough.
fn paths_of(turn: Turn) -> vec2<u32> {
    var n = vec2(1u, 1u);
    var by = turn.by;
    while 2u * n.x * n.y <= frame.options.y {
        if max(by.x, by.y) <= frame.start.z && n.x * n.y >= frame.options.x {
            break;
        }
        if by.y > by.x {
            n.y *= 2u;
            by.y *= 0.5;
        } else {
            n.x *= 2u;
            by.x *= 0.5;
        }
    }
    return n;
}

// The points seen through the beams of a pixel that the object covers, whose mirror direction turns so.
fn inner_paths(place: vec2<u32>, center: SurfacePoint, turn: Turn) -> Pixel {
    let n = paths_of(turn);
    let first = atomicAdd(&counters.n_paths, n.x * n.y);
    if n.x * n.y == 1u {
        starts[first] = PathStart(center, turn_of(place, 0u), 0.0, 0.0, 0.0);
        return Pixel(1.0, first, 1u, NONE);
    }
    let across = vec2(-turn.axis.y, turn.axis.x);
    var count = 0u;
    for (var k = 0u; k < n.x * n.y; k++) {
        let share = PIXEL_SIDE * ((vec2(f32(k % n.x), f32(k / n.x)) + 0.5) / vec2<f32>(n) - 0.5);
        let at = vec2<f32>(place) + 0.5 + share.x * turn.axis + share.y * across;
        let point = trace_beam(at, turn.axis / f32(n.x), across / f32(n.y));
        if point.is_seen > 0.0 {
            starts[first + count] = PathStart(point, turn_of(place, count), 0.0, 0.0, 0.0);
            count++;
        }
    }
    clear_paths(first + count, first + n.x * n.y);
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
        let point = trace_beam(nearest, vec2(1.0 / f32(n), 0.0), vec2(0.0, 1.0 / f32(n)));
        if point.is_seen > 0.0 {
            starts[first + count] = PathStart(point, turn_of(place, count), 0.0, 0.0, 0.0);
            count++;
        }
    }
    clear_paths(first + count, first + n * n);
    return Pixel(f32(n_hits) / f32(SUBSAMPLES * SUBSAMPLES), first, count, NONE);
}

fn subsample_at(place: vec2<u32>, corner_of_square: vec2<u32>, k: u32, n_inside: u32) -> vec2<f32> {
    let square = corner_of_square + vec2(k % n_inside, k / n_inside);
    let share = (vec2<f32>(square) + 0.5) / f32(SUBSAMPLES);
    return vec2<f32>(place) + 0.5 + (share - 0.5) * PIXEL_SIDE;
}

fn clear_paths(first: u32, end: u32) {
    for (var path = first; path < end; path++) {
        starts[path].turn = -1.0;
    }
}
