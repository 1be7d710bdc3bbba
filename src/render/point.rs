//! A single point of the object, as a person inspects it: what it is made of and the light that it mirrors.

use glam::Vec3;

use super::path::scratch::{ShadeScratch, light_surfaces};
use super::path::shade::settled_path;
use super::path::trace::{MAX_VERTICES, PIXEL_STD, Seen, trace_path};
use super::scene::Scene;
use crate::geometry::Camera;
use crate::neif::light::light_path::PathVertex;
use crate::neif::light::lobe::kappa_from_roughness;
use crate::neif::light::shading::SurfacePoint;
use crate::neif::surface::values::Surface;
use crate::neif::{MaterialEdit, Regions};

/// A place on the surface and from where it is looked at, world coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointView {
    /// The place.
    pub position: Vec3,
    /// Unit shading normal.
    pub normal: Vec3,
    /// Unit normal of the triangle there, on the same side.
    pub face_normal: Vec3,
    /// Unit direction to the eye.
    pub to_eye: Vec3,
    /// Distance to the eye.
    pub distance: f32,
    /// Angle of a pixel, radians.
    pub pixel_angle: f32,
}

/// What there is to know of a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointValues {
    /// As learned, roughness as renderers mean it.
    pub learned: Surface,
    /// After all edits; the tint with the edit's specular gain.
    pub edited: Surface,
    /// Linear radiance that the lobe gathers; black where the surface is seen from behind.
    pub incoming: Vec3,
    /// Linear radiance that the point sends to the eye.
    pub outgoing: Vec3,
    /// Roughness of the cone by which the lobe is looked up, `[0, 1]`.
    pub cone_roughness: f32,
}

impl PointView {
    /// The place as a camera sees it.
    pub fn from_camera(position: Vec3, normal: Vec3, face_normal: Vec3, camera: &Camera) -> Self {
        let to_eye = camera.position() - position;
        Self {
            position,
            normal,
            face_normal,
            to_eye: to_eye.normalize_or(normal),
            distance: to_eye.length(),
            pixel_angle: camera.pixel_angle(),
        }
    }

    /// Mirror direction, unit.
    pub fn reflected(&self) -> Vec3 {
        self.surface_point().reflected()
    }

    /// Angle between the normal and the direction to the eye, radians; above π/2 the surface is seen from behind.
    pub fn viewing_angle(&self) -> f32 {
        self.normal.dot(self.to_eye).clamp(-1.0, 1.0).acos()
    }

    fn surface_point(&self) -> SurfacePoint {
        let spread = self.pixel_angle * PIXEL_STD;
        SurfacePoint {
            position: self.position,
            normal: self.normal,
            to_eye: self.to_eye,
            base: self.distance * spread,
            spread,
        }
    }
}

/// Evaluates a point; `None` without an object.
pub fn point_values(
    scene: &Scene,
    view: &PointView,
    scratch: &mut ShadeScratch,
) -> Option<PointValues> {
    let object = scene.object.as_ref()?;
    let first = Seen {
        point: view.surface_point(),
        face_normal: view.face_normal,
    };
    let at = std::iter::once((view.position, view.normal));
    let plain = Scene {
        edit: MaterialEdit::default(),
        regions: Regions::default(),
        diffuse_light: None,
        trained_in: None,
        ..scene.clone()
    };
    light_surfaces(&mut scratch.edited, &plain, object, at, |_| true);
    let learned = scratch.edited.surfaces()[0];
    let mut path = [PathVertex::default(); MAX_VERTICES];
    let path = trace_path(&object.tracer, &first, 0.0, &mut path, MAX_VERTICES);
    let light = settled_path(scene, object, path, scratch);
    let edited = &scratch.edited;
    let (surface, gain) = (edited.surfaces()[0], edited.specular_gain()[0]);
    let is_new = edited.has_new_roughness()[0] || !scene.has_own_light();
    let cone_roughness = if is_new {
        surface.roughness
    } else {
        edited.learned_roughness()[0]
    };
    let is_seen = view.normal.dot(view.to_eye) > 0.0;
    Some(PointValues {
        learned,
        edited: Surface {
            tint: surface.tint * gain,
            ..surface
        },
        incoming: if is_seen { light.incoming } else { Vec3::ZERO },
        outgoing: light.value,
        cone_roughness,
    })
}

/// Angle from its axis at which the lobe of a roughness falls to half of its peak, radians, at most π.
///
/// `exp(kappa (cos a - 1)) = 1/2`.
pub fn lobe_half_width(roughness: f32) -> f32 {
    let cos = 1.0 - std::f32::consts::LN_2 / kappa_from_roughness(roughness);
    cos.max(-1.0).acos()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::neif::RoughnessEdit;
    use crate::render::path::trace::trace_pixel;
    use crate::render::{GBuffer, Layer, PathOptions, shade_object, test_scene};

    #[test]
    fn a_point_s_values_are_those_of_its_pixel() {
        let mut scene = test_scene::scene();
        scene.edit = MaterialEdit {
            roughness: RoughnessEdit::Constant(0.6),
            tint_scale: 0.5,
            ..MaterialEdit::default()
        };
        // Pixels small enough for one path, as the point has. Beside the middle: where the eye is straight above,
        // rounding decides how the cones are turned about the lobe's axis.
        let camera = test_scene::camera(1201, 1201);
        let object = scene.object.clone().unwrap();
        let seen = trace_pixel(&object.tracer, &camera, (720.5, 600.5), 1.0).unwrap();
        let (position, normal) = (seen.point.position, seen.point.normal);
        let view = PointView::from_camera(position, normal, seen.face_normal, &camera);
        let mut scratch = ShadeScratch::default();
        let values = point_values(&scene, &view, &mut scratch).unwrap();
        assert_eq!(values.edited.roughness, 0.6);
        let gbuffer = GBuffer::trace(Some(&object.tracer), &camera, 600..601, PathOptions::PLAIN);
        let mut pixel = [[0.0; 3]];
        let at = [600 * 1201 + 720];
        shade_object(
            &scene,
            &gbuffer,
            &at,
            Layer::Final,
            &mut pixel,
            &mut scratch,
        );
        let difference = (Vec3::from(pixel[0]) - values.outgoing).abs().max_element();
        assert!(
            difference < 0.01 * values.outgoing.max_element(),
            "{pixel:?} against {values:?}"
        );
        assert!(view.viewing_angle() < std::f32::consts::FRAC_PI_2);
    }

    #[test]
    fn lobes_widen_with_roughness() {
        let widths = [0.1, 0.3, 0.6, 1.0].map(lobe_half_width);
        assert!(widths.is_sorted(), "{widths:?}");
        assert!(widths[0] > 0.0 && widths[3] <= std::f32::consts::PI);
    }
}
