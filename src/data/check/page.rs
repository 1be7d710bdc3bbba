//! The report as a page of text.

use std::fmt::{Display, Formatter, Result};

use super::DatasetReport;

impl Display for DatasetReport {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        writeln!(f, "{}  ({})", self.name, self.root.display())?;
        line(f, "format", format_args!("{}", self.recognised))?;
        let n = self.views;
        line(
            f,
            "views",
            format_args!("{} train, {} val, {} test", n.train, n.val, n.test),
        )?;
        if !self.split_rule.is_empty() {
            line(f, "split", format_args!("{}", self.split_rule))?;
        }
        for r in &self.resolutions {
            let kind = if self.hdr { "linear" } else { "sRGB" };
            let text = format!("{} x {} px, {kind}, {} views", r.width, r.height, r.n_views);
            line(f, "photos", format_args!("{text}"))?;
        }
        if !self.surroundings_visible {
            line(
                f,
                "background",
                format_args!("not visible (cut-out photos)"),
            )?;
        }
        self.lens_line(f)?;
        self.camera_line(f)?;
        self.object_lines(f)?;
        self.condition_lines(f)?;
        if self.problems.is_empty() {
            return writeln!(f, "no problems found");
        }
        for problem in &self.problems {
            writeln!(f, "{problem}")?;
        }
        Ok(())
    }
}

impl DatasetReport {
    fn lens_line(&self, f: &mut Formatter<'_>) -> Result {
        let lens = &self.lens;
        let distortion = if lens.distorted {
            "distorted"
        } else {
            "undistorted"
        };
        let focal = span(lens.focal_px, 1);
        let fov = span(lens.fov_x_deg, 1);
        line(
            f,
            "lens",
            format_args!("focal length {focal} px, {fov} degrees wide, {distortion}"),
        )
    }

    fn camera_line(&self, f: &mut Formatter<'_>) -> Result {
        let c = &self.cameras;
        let [x, y, z] = c.look_at;
        let distance = span(c.distance, 3);
        line(
            f,
            "cameras",
            format_args!(
                "{distance} units from ({x:.3}, {y:.3}, {z:.3}), spread over {:.3}",
                c.extent
            ),
        )?;
        if let Some([x, y, z]) = self.up {
            let why = if self.up_is_given {
                "as given"
            } else {
                "as the cameras were held; --up says otherwise"
            };
            line(f, "up", format_args!("({x:.3}, {y:.3}, {z:.3}), {why}"))?;
        }
        let Some(points) = &self.points else {
            return Ok(());
        };
        let error = points.median_error_px;
        let error = error.map_or(String::new(), |e| format!(", seen to {e:.2} px (median)"));
        line(
            f,
            "points",
            format_args!(
                "{}{error}, nine tenths from {:.3?} to {:.3?}",
                points.n_points, points.min, points.max
            ),
        )
    }

    fn condition_lines(&self, f: &mut Formatter<'_>) -> Result {
        let c = &self.conditions;
        line(
            f,
            "taken",
            format_args!(
                "from {:.0} of 360 degrees around the object, looking into {:.0} % of all directions",
                c.circle_covered_deg,
                100.0 * c.directions_seen
            ),
        )?;
        let stops = |what: &str, ev: Option<f32>| ev.map(|ev| format!("{ev:.2} stops {what}"));
        let told = [
            stops("apart from neighbouring photos", c.exposure_jitter_ev),
            stops("from least to most by EXIF", c.noted_exposure_range_ev),
        ];
        let told: Vec<String> = told.into_iter().flatten().collect();
        if !told.is_empty() {
            line(f, "exposure", format_args!("{}", told.join(", ")))?;
        }
        if let Some(share) = c.same_background {
            let share = 100.0 * share;
            line(
                f,
                "background",
                format_args!("the same in {share:.0} % of photos from different sides"),
            )?;
        }
        Ok(())
    }

    fn object_lines(&self, f: &mut Formatter<'_>) -> Result {
        match &self.masks {
            Some(m) => line(
                f,
                "masks",
                format_args!(
                    "{} views; object covers {:.1} % of the picture ({:.1} to {:.1} %)",
                    m.n_views,
                    100.0 * m.mean,
                    100.0 * m.min,
                    100.0 * m.max
                ),
            )?,
            None => line(f, "masks", format_args!("none"))?,
        }
        match &self.mesh {
            Some(m) => {
                let closed = if m.watertight { "watertight" } else { "open" };
                line(
                    f,
                    "mesh",
                    format_args!(
                        "{} vertices, {} triangles, {closed}, from {:.3?} to {:.3?}",
                        m.n_vertices, m.n_triangles, m.min, m.max
                    ),
                )?;
            }
            None => line(f, "mesh", format_args!("none"))?,
        }
        match &self.agreement {
            Some(a) => line(
                f,
                "fit",
                format_args!(
                    "mesh over masks {:.3} (worst {:.3}, view {})",
                    a.mean_iou, a.worst_iou, a.worst_view
                ),
            ),
            None => Ok(()),
        }
    }
}

fn line(f: &mut Formatter<'_>, label: &str, text: std::fmt::Arguments<'_>) -> Result {
    writeln!(f, "  {label:<11} {text}")
}

/// A range, or one number where both ends print alike.
fn span([min, max]: [f32; 2], n_digits: usize) -> String {
    let (low, high) = (format!("{min:.n_digits$}"), format!("{max:.n_digits$}"));
    if low == high {
        low
    } else {
        format!("{low} to {high}")
    }
}
