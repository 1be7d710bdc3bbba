//! A plot of error against time, as SVG and as PNG.

use std::path::Path;

use anyhow::anyhow;
use neif::data::write_png_srgb;
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::{FontStyle, register_font};

use crate::cli::failure::Failure;
use crate::cli::output;

/// Size of the picture, pixels.
const SIZE: (u32, u32) = (900, 560);
/// Name under which the bundled font is known to the plot.
const FONT: &str = "neif";

/// A curve: points of (seconds, dB).
#[derive(Clone, Debug)]
pub(super) struct Curve {
    /// What it shows.
    pub(super) name: String,
    /// Its points, by time.
    pub(super) points: Vec<(f64, f64)>,
}

/// Writes `stem.svg` and `stem.png`.
pub(super) fn write_plot(stem: &Path, curves: &[Curve]) -> Result<(), Failure> {
    let font = register_font(FONT, FontStyle::Normal, epaint_default_fonts::UBUNTU_LIGHT);
    if font.is_err() {
        return Err(Failure::Failed(anyhow!("the plot's font cannot be read")));
    }
    let mut svg = String::new();
    draw(SVGBackend::with_string(&mut svg, SIZE), curves)?;
    output::file(&stem.with_extension("svg"), &svg)?;
    let mut rgb = vec![0_u8; (SIZE.0 * SIZE.1 * 3) as usize];
    draw(BitMapBackend::with_buffer(&mut rgb, SIZE), curves)?;
    let (pixels, _) = rgb.as_chunks::<3>();
    let pixels = pixels.iter().map(|p| p.map(|v| f32::from(v) / 255.0));
    let pixels: Vec<[f32; 3]> = pixels.collect();
    write_png_srgb(&stem.with_extension("png"), SIZE.0, SIZE.1, &pixels)?;
    Ok(())
}

fn draw(backend: impl DrawingBackend, curves: &[Curve]) -> Result<(), Failure> {
    draw_chart(&backend.into_drawing_area(), curves)
        .map_err(|error| Failure::Failed(anyhow!("the plot failed: {error}")))
}

fn draw_chart<B: DrawingBackend>(
    area: &DrawingArea<B, Shift>,
    curves: &[Curve],
) -> Result<(), DrawingAreaErrorKind<B::ErrorType>> {
    let range = |pick: fn(&(f64, f64)) -> f64| {
        let all = || curves.iter().flat_map(|curve| &curve.points).map(pick);
        let low = all().fold(f64::INFINITY, f64::min);
        (low, all().fold(f64::NEG_INFINITY, f64::max))
    };
    let ((first, last), (low, high)) = (range(|p| p.0), range(|p| p.1));
    if !(first.is_finite() && low.is_finite()) {
        return Ok(());
    }
    area.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(area)
        .margin(16)
        .x_label_area_size(44)
        .y_label_area_size(56)
        .build_cartesian_2d(
            (first * 0.9..last * 1.1).log_scale(),
            (low - 1.0).floor()..(high + 1.0).ceil(),
        )?;
    chart
        .configure_mesh()
        .x_desc("seconds of training")
        .y_desc("PSNR on test views, dB")
        .label_style((FONT, 15))
        .axis_desc_style((FONT, 16))
        .x_label_formatter(&|seconds| format!("{seconds:.0}"))
        .draw()?;
    for (i, curve) in curves.iter().enumerate() {
        let color = Palette99::pick(i).to_rgba();
        chart
            .draw_series(LineSeries::new(
                curve.points.iter().copied(),
                color.stroke_width(2),
            ))?
            .label(&curve.name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 22, y)], color.stroke_width(2)));
        let dots = curve
            .points
            .iter()
            .map(|&point| Circle::new(point, 3, color.filled()));
        chart.draw_series(dots)?;
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::LowerRight)
        .background_style(WHITE.mix(0.8))
        .label_font((FONT, 15))
        .draw()?;
    area.present()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_files_hold_the_curves() {
        let folder = tempfile::tempdir().unwrap();
        let curve = Curve {
            name: "fast, object".to_owned(),
            points: vec![(10.0, 28.0), (60.0, 31.5), (300.0, 33.0)],
        };
        write_plot(&folder.path().join("error"), &[curve]).unwrap();
        let svg = std::fs::read_to_string(folder.path().join("error.svg")).unwrap();
        assert!(
            svg.contains("fast, object") && svg.contains("polyline"),
            "{svg}"
        );
        let photo = neif::data::read_photo(&folder.path().join("error.png")).unwrap();
        let colored = (0..photo.n_pixels())
            .filter(|&i| {
                let [r, g, b] = photo.srgb(i);
                (r - g).abs().max((g - b).abs()) > 0.2
            })
            .count();
        assert!(colored > 500, "a curve of {colored} pixels");
    }
}
