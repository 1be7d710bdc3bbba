//! The gizmo that moves, turns and scales the environment: its shape in the picture, and what a drag of it means.
//!
//! A drag is measured from where it began, so that steps do not add up errors. All points of the picture are in
//! pixels of the window. Turning and scaling keep the anchor, the point that the gizmo stands at, where it is.

use glam::{Vec2, Vec3};

use crate::app::viewport::environment_control::turned;
use crate::geometry::Camera;
use crate::neif::EnvironmentTransform;

/// Radius of the rings, in arrows.
const RING: f32 = 0.8;
/// Where arrows begin, in arrows from the centre.
const ARROW_START: f32 = 0.14;
/// Where the scale handle is, in arrows from the centre: left and down, where no arrow of an upright axis goes.
const SCALE_AT: Vec2 = Vec2::new(-0.85, 0.85);
/// Segments of a whole ring.
const RING_SEGMENTS: usize = 64;
/// Cosine between axis and view below which a ring is seen from its edge.
const EDGE_ON: f32 = 0.2;
/// An arrow that looks shorter than this share of a whole one points at the camera and cannot be dragged.
const LEAST_ARROW: f32 = 0.2;
/// A pull along an arrow by more than this many arrows is a slip near the vanishing point.
const FARTHEST: f32 = 200.0;
/// Scales that can be reached.
const SCALES: std::ops::RangeInclusive<f32> = 0.1..=10.0;

/// An axis of the world.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Axis {
    /// The first.
    X,
    /// The second.
    Y,
    /// The third.
    Z,
}

impl Axis {
    /// All three.
    pub const ALL: [Self; 3] = [Self::X, Self::Y, Self::Z];

    /// The unit vector.
    pub fn unit(self) -> Vec3 {
        Vec3::AXES[self as usize]
    }

    /// Its letter.
    pub fn name(self) -> &'static str {
        ["X", "Y", "Z"][self as usize]
    }
}

/// A part of the gizmo that can be held.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Handle {
    /// The arrow along an axis.
    Move(Axis),
    /// The ring about an axis.
    Turn(Axis),
    /// The square.
    Scale,
}

impl Handle {
    /// All of them; those that win where they overlap come last.
    pub const ALL: [Self; 7] = [
        Self::Turn(Axis::X),
        Self::Turn(Axis::Y),
        Self::Turn(Axis::Z),
        Self::Scale,
        Self::Move(Axis::X),
        Self::Move(Axis::Y),
        Self::Move(Axis::Z),
    ];

    /// What it does, for people.
    pub fn name(self) -> String {
        match self {
            Self::Move(axis) => format!("Move environment along {}", axis.name()),
            Self::Turn(axis) => format!("Rotate environment about {}", axis.name()),
            Self::Scale => "Scale environment".to_owned(),
        }
    }
}

/// Round steps of a drag.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Snap {
    /// Of a move, scene units.
    pub length: f32,
    /// Of a turn, degrees.
    pub degrees: f32,
    /// Of the scale.
    pub scale: f32,
}

impl Snap {
    /// Steps of 15 degrees and of a round number near a tenth of the object's size: 0.1 m for a chair in metres.
    pub fn for_object(size: f32) -> Self {
        let wanted = (0.1 * size).clamp(1e-6, 1e6);
        let decade = 10_f32.powf(wanted.log10().floor());
        let rounds = [1.0, 2.0, 5.0, 10.0].map(|step| step * decade);
        let misfit = |step: f32| (step / wanted).ln().abs();
        let nearest = rounds
            .into_iter()
            .min_by(|a, b| misfit(*a).total_cmp(&misfit(*b)));
        Self {
            length: nearest.unwrap_or(wanted),
            degrees: 15.0,
            scale: 0.1,
        }
    }
}

/// The gizmo as a camera sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gizmo {
    camera: Camera,
    center: Vec3,
    center_px: Vec2,
    /// Length of an arrow, scene units.
    length: f32,
    arrow_px: f32,
}

impl Gizmo {
    /// The gizmo at a world point with arrows of that many pixels; none where the point is not in front of the camera.
    pub fn new(camera: &Camera, center: Vec3, arrow_px: f32) -> Option<Self> {
        let depth = (center - camera.position()).dot(camera.forward());
        let length = arrow_px * depth * camera.pixel_angle();
        let center_px = camera.project(center)?;
        (length > 0.0 && length.is_finite()).then_some(Self {
            camera: *camera,
            center,
            center_px,
            length,
            arrow_px,
        })
    }

    /// The unit direction from the camera to the centre.
    fn view(&self) -> Vec3 {
        (self.center - self.camera.position()).normalize_or_zero()
    }

    /// The line that a handle is drawn as; empty where it is not clear enough to be dragged.
    pub fn outline(&self, handle: Handle) -> Vec<Vec2> {
        match handle {
            Handle::Move(axis) => self.arrow(axis),
            Handle::Turn(axis) => self.ring(axis),
            Handle::Scale => vec![self.center_px, self.center_px + SCALE_AT * self.arrow_px],
        }
    }

    fn arrow(&self, axis: Axis) -> Vec<Vec2> {
        let point = |share: f32| {
            self.camera
                .project(self.center + axis.unit() * (share * self.length))
        };
        match (point(ARROW_START), point(1.0)) {
            (Some(a), Some(b)) if (b - a).length() > LEAST_ARROW * self.arrow_px => vec![a, b],
            _ => Vec::new(),
        }
    }

    /// The half of the ring that faces the camera, or all of it where it is seen from above.
    fn ring(&self, axis: Axis) -> Vec<Vec2> {
        let (back, side) = self.ring_axes(axis);
        let view = self.view();
        let points = (0..=RING_SEGMENTS).filter_map(|i| {
            let angle = i as f32 / RING_SEGMENTS as f32 * std::f32::consts::TAU;
            let out = back * angle.cos() + side * angle.sin();
            (out.dot(view) < 0.3)
                .then(|| self.center + out * (RING * self.length))
                .and_then(|p| self.camera.project(p))
        });
        points.collect()
    }

    /// Unit vectors in the plane of a ring: away from the camera, and a quarter turn about the axis further.
    fn ring_axes(&self, axis: Axis) -> (Vec3, Vec3) {
        let (axis, view) = (axis.unit(), self.view());
        let back = view - axis * view.dot(axis);
        let back = back
            .try_normalize()
            .unwrap_or_else(|| axis.any_orthonormal_vector());
        (back, axis.cross(back))
    }

    /// Where a handle is best held; none where it is not drawn.
    pub fn knob(&self, handle: Handle) -> Option<Vec2> {
        let outline = self.outline(handle);
        match handle {
            Handle::Move(_) | Handle::Scale => outline.last().copied(),
            // Beside the point nearest the camera, over which an arrow may lie.
            Handle::Turn(_) => outline.get(outline.len() * 3 / 5).copied(),
        }
    }

    /// The handle nearest to a pixel, within `reach` pixels.
    pub fn nearest(&self, at: Vec2, reach: f32, handles: &[Handle]) -> Option<Handle> {
        let distance = |handle: Handle| {
            let outline = self.outline(handle);
            let to_line = outline.windows(2).map(|ends| to_segment(at, ends));
            match handle {
                // The line to the square is no handle.
                Handle::Scale => outline.last().map_or(f32::INFINITY, |p| p.distance(at)),
                _ => to_line.fold(f32::INFINITY, f32::min),
            }
        };
        let within = handles.iter().map(|&handle| (handle, distance(handle)));
        within
            .filter(|(_, distance)| *distance <= reach)
            .min_by(|a, b| a.1.total_cmp(&b.1))
            .map(|(handle, _)| handle)
    }

    /// How far along the line from `origin` in the unit direction `axis` a pixel points, scene units.
    fn along(&self, origin: Vec3, axis: Vec3, at: Vec2) -> Option<f32> {
        let camera = &self.camera;
        let start = camera.project(origin)?;
        let on_screen = camera.project(origin + axis * self.length)? - start;
        // Onto the projected axis first: the ray then meets the axis itself, however far off the pointer is.
        let share = (at - start).dot(on_screen) / on_screen.length_squared();
        let on_line = start + on_screen * share;
        let ray = camera.ray(on_line.x, on_line.y);
        let to_origin = origin - ray.origin;
        let cos = axis.dot(ray.direction);
        let t = (cos * ray.direction.dot(to_origin) - axis.dot(to_origin)) / (1.0 - cos * cos);
        (t.is_finite() && t.abs() < FARTHEST * self.length).then_some(t)
    }

    /// The angle about an axis that a pixel points at, radians; only differences mean something.
    fn angle(&self, axis: Axis, at: Vec2) -> Option<f32> {
        let (back, side) = self.ring_axes(axis);
        if self.view().dot(axis.unit()).abs() < EDGE_ON {
            // From the edge a ring is a line: its near side moves along it.
            let near = self.center - back * (RING * self.length);
            return Some(self.along(near, -side, at)? / (RING * self.length));
        }
        let ray = self.camera.ray(at.x, at.y);
        let t = (self.center - ray.origin).dot(axis.unit()) / ray.direction.dot(axis.unit());
        let out = ray.origin + ray.direction * t - self.center;
        (t > 0.0 && out.is_finite()).then(|| out.dot(side).atan2(out.dot(back)))
    }

    /// Distance of a pixel from the centre in the direction of the scale handle, in pixels.
    fn reach(&self, at: Vec2) -> f32 {
        (at - self.center_px).dot(SCALE_AT.normalize_or_zero())
    }
}

/// A handle that is held, and everything a drag is measured from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grab {
    /// Which.
    pub handle: Handle,
    /// Where the environment stood.
    pub start: EnvironmentTransform,
    /// The point that the gizmo holds, in the environment's coordinates.
    pub anchor: Vec3,
    /// The window's camera.
    pub camera: Camera,
    /// Length of an arrow in pixels.
    pub arrow_px: f32,
    /// Where it was taken, in pixels.
    pub at: Vec2,
}

impl Grab {
    /// Where the environment stands when the handle is pulled to a pixel; none where that points nowhere.
    pub fn dragged_to(&self, at: Vec2, snap: Option<Snap>) -> Option<EnvironmentTransform> {
        let start = &self.start;
        let gizmo = Gizmo::new(&self.camera, place(start, self.anchor), self.arrow_px)?;
        let rounded = |value: f32, step: Option<f32>| match step {
            Some(step) => (value / step).round() * step,
            None => value,
        };
        let moved = match self.handle {
            Handle::Move(axis) => {
                let along = |at| gizmo.along(gizmo.center, axis.unit(), at);
                let amount = rounded(along(at)? - along(self.at)?, snap.map(|snap| snap.length));
                return Some(EnvironmentTransform {
                    translate: start.translate + axis.unit() * amount,
                    ..*start
                });
            }
            Handle::Turn(axis) => {
                let angle = gizmo.angle(axis, at)? - gizmo.angle(axis, self.at)?;
                let degrees = rounded(angle.to_degrees(), snap.map(|snap| snap.degrees));
                turned(start, axis.unit(), degrees)
            }
            Handle::Scale => {
                let factor = gizmo.reach(at) / gizmo.reach(self.at).max(1.0);
                let scale = rounded(start.scale * factor, snap.map(|snap| snap.scale));
                EnvironmentTransform {
                    scale: scale.clamp(*SCALES.start(), *SCALES.end()),
                    ..*start
                }
            }
        };
        // The anchor stays: turning and scaling are about the gizmo, not about the origin.
        let shift = place(start, self.anchor) - place(&moved, self.anchor);
        Some(EnvironmentTransform {
            translate: moved.translate + shift,
            ..moved
        })
    }
}

/// Where a point of the environment is in the world.
pub fn place(transform: &EnvironmentTransform, anchor: Vec3) -> Vec3 {
    transform.environment_from_world().world_point(anchor)
}

fn to_segment(p: Vec2, ends: &[Vec2]) -> f32 {
    let (a, b) = (ends[0], ends[1]);
    let along = (p - a).dot(b - a) / (b - a).length_squared().max(1e-12);
    p.distance(a + (b - a) * along.clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const ARROW_PX: f32 = 100.0;

    fn vector(range: std::ops::Range<f32>) -> impl Strategy<Value = Vec3> {
        [range.clone(), range.clone(), range].prop_map(Vec3::from_array)
    }

    fn grabs() -> impl Strategy<Value = Grab> {
        let handle = prop::sample::select(Handle::ALL.to_vec());
        let start = (vector(-180.0..180.0), vector(-1.0..1.0), 0.3..3.0_f32);
        let eye = vector(-1.0..1.0).prop_filter("a direction", |eye| eye.length() > 0.2);
        let scene = (start, vector(-0.5..0.5), eye, 2.0..20.0_f32);
        (handle, scene).prop_map(|(handle, (start, anchor, eye, distance))| {
            let start = EnvironmentTransform {
                rotate_deg: start.0,
                translate: start.1,
                scale: start.2,
                ..EnvironmentTransform::default()
            };
            let center = place(&start, anchor);
            let eye = center + eye.normalize_or_zero() * distance;
            let up = if eye.x.abs() < eye.y.abs() {
                Vec3::X
            } else {
                Vec3::Y
            };
            let camera = Camera::look_at(eye, center + 0.1 * up, up, 0.8, 900, 700);
            Grab {
                handle,
                start,
                anchor,
                camera,
                arrow_px: ARROW_PX,
                at: Vec2::ZERO,
            }
        })
    }

    fn gizmo(grab: &Grab) -> Gizmo {
        let center = place(&grab.start, grab.anchor);
        Gizmo::new(&grab.camera, center, grab.arrow_px).expect("in front of the camera")
    }

    proptest! {
        #[test]
        fn a_drag_along_an_axis_moves_by_what_was_passed_over(
            grab in grabs(), axis in prop::sample::select(Axis::ALL.to_vec()), amount in -1.5..1.5_f32,
        ) {
            let gizmo = gizmo(&grab);
            let amount = amount * gizmo.length;
            prop_assume!(gizmo.view().dot(axis.unit()).abs() < 0.9);
            let at = |along: f32| gizmo.camera.project(gizmo.center + axis.unit() * along).unwrap();
            let grab = Grab { handle: Handle::Move(axis), at: at(0.7 * gizmo.length), ..grab };
            let moved = grab.dragged_to(at(0.7 * gizmo.length + amount), None).unwrap();
            let expected = grab.start.translate + axis.unit() * amount;
            prop_assert!((moved.translate - expected).length() < 5e-3 * gizmo.length, "{} and {expected}", moved.translate);
            prop_assert_eq!(moved.rotate_deg, grab.start.rotate_deg);
        }

        #[test]
        fn a_drag_around_a_ring_turns_what_is_there_along(
            grab in grabs(), axis in prop::sample::select(Axis::ALL.to_vec()), from in 0.0..6.0_f32, by in -3.0..3.0_f32,
        ) {
            let gizmo = gizmo(&grab);
            prop_assume!(gizmo.view().dot(axis.unit()).abs() > 1.5 * EDGE_ON);
            let (u, v) = gizmo.ring_axes(axis);
            let point = |angle: f32| gizmo.center + (u * angle.cos() + v * angle.sin()) * (RING * gizmo.length);
            let at = |angle: f32| gizmo.camera.project(point(angle)).unwrap();
            let grab = Grab { handle: Handle::Turn(axis), at: at(from), ..grab };
            let moved = grab.dragged_to(at(from + by), None).unwrap();
            // What was under the pointer at first is under it at the end.
            let held = grab.start.environment_from_world().point(point(from));
            let off = (place(&moved, held) - point(from + by)).length();
            prop_assert!(off < 0.02 * gizmo.length, "off by {off} of {}", gizmo.length);
        }

        #[test]
        fn turning_and_scaling_keep_the_anchor_and_all_stays_finite(
            grab in grabs(), at in [-2000.0..2000.0_f32, -2000.0..2000.0_f32], is_snapped in any::<bool>(),
        ) {
            let gizmo = gizmo(&grab);
            let knob = gizmo.knob(grab.handle).unwrap_or(gizmo.center_px);
            let grab = Grab { at: knob, ..grab };
            let snap = is_snapped.then(|| Snap::for_object(2.0));
            let Some(moved) = grab.dragged_to(Vec2::from_array(at), snap) else { return Ok(()) };
            prop_assert!(moved.translate.is_finite() && moved.rotate_deg.is_finite());
            prop_assert!(SCALES.contains(&moved.scale));
            if !matches!(grab.handle, Handle::Move(_)) {
                let off = (place(&moved, grab.anchor) - gizmo.center).length();
                prop_assert!(off < 1e-3, "the anchor went {off}");
            }
        }

        #[test]
        fn every_knob_is_the_handle_s_own(grab in grabs()) {
            let gizmo = gizmo(&grab);
            if let Some(knob) = gizmo.knob(grab.handle) {
                prop_assert_eq!(gizmo.nearest(knob, 1.0, &[grab.handle]), Some(grab.handle));
            }
        }
    }

    #[test]
    fn snapping_moves_in_round_steps() {
        assert_eq!(Snap::for_object(1.1).length, 0.1);
        assert!((Snap::for_object(45.0).length - 5.0).abs() < 1e-4);
        let eye = Vec3::new(0.0, -5.0, 1.0);
        let camera = Camera::look_at(eye, Vec3::ZERO, Vec3::Z, 0.8, 900, 700);
        let grab = Grab {
            handle: Handle::Move(Axis::X),
            start: EnvironmentTransform::default(),
            anchor: Vec3::ZERO,
            camera,
            arrow_px: ARROW_PX,
            at: camera.project(Vec3::X * 0.5).unwrap(),
        };
        let snap = Some(Snap::for_object(1.0));
        let moved = grab.dragged_to(camera.project(Vec3::X * 0.83).unwrap(), snap);
        assert!((moved.unwrap().translate - Vec3::X * 0.3).length() < 1e-5);
    }
}
