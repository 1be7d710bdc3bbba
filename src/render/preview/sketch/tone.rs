//! The display transform of a picture by a table: three powers a pixel would take as long as the rest of it.

use crate::render::scene::{Layer, Scene, Shown};

/// Entries of the table; they are spread evenly over the square root, so that dark values have as many as they need.
const N: usize = 4096;

/// Display bytes of linear values.
pub(super) struct Tone {
    /// Exposure and tone map, before the table.
    shown: Shown,
    bytes: Vec<u8>,
}

impl Tone {
    /// The transform of [`crate::render::compose`] for a layer.
    pub(super) fn new(scene: &Scene, layer: Layer) -> Self {
        let shown = scene.shown(layer);
        let byte = |i: usize| {
            let linear = (i as f32 / (N - 1) as f32).powi(2);
            let value = shown
                .display
                .map_or(linear, |display| display.value(linear));
            (value.clamp(0.0, 1.0) * 255.0 + 0.5) as u8
        };
        Self {
            shown,
            bytes: (0..N).map(byte).collect(),
        }
    }

    /// Values above 1 are shown as 1; what is not a number as 0.
    pub(super) fn bytes(&self, linear: [f32; 3]) -> [u8; 3] {
        // Written so that what is not a number is 0.
        let light = linear.map(|v| if v > 0.0 { v * self.shown.gain } else { 0.0 });
        let shown = self.shown.tone_map.apply(light);
        shown.map(|v| self.bytes[(v.min(1.0).sqrt() * (N - 1) as f32 + 0.5) as usize])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::ToneMap;
    use crate::render::path::shade::compose;
    use crate::render::test_scene::scene;

    #[test]
    fn the_table_is_the_display_transform() {
        let mut scene = scene();
        for (layer, map) in [
            (Layer::Final, ToneMap::Photo),
            (Layer::Final, ToneMap::Neutral),
            (Layer::Normal, ToneMap::Neutral),
        ] {
            scene.tone_map = map;
            let tone = Tone::new(&scene, layer);
            for i in 0..2000 {
                let v = i as f32 / 1500.0;
                let exact = compose(&scene, layer, 1.0, [v; 3], [0.0; 3])[0] * 255.0;
                let byte = f32::from(tone.bytes([v; 3])[0]);
                assert!(
                    (byte - exact).abs() < 1.2,
                    "{layer} {map} {v}: {byte}, not {exact}"
                );
            }
            if map == ToneMap::Photo {
                assert_eq!(tone.bytes([f32::NAN, -1.0, f32::INFINITY]), [0, 0, 255]);
            }
        }
    }
}
