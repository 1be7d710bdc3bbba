//! The report as a page of text.

use std::fmt::{Display, Formatter, Result};

use super::DatasetReport;

impl Display for DatasetReport {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        writeln!(f, "{}  ({})", self.name, self.root.display())?;
        let mut page = Page::default();
        self.add_views(&mut page);
        self.add_cameras(&mut page);
        self.add_object(&mut page);
        self.add_conditions(&mut page);
        for (label, text) in page.0 {
            writeln!(f, "  {label:<11} {text}")?;
        }
        if self.problems.is_empty() {
            return writeln!(f, "no problems found");
        }
        for problem in &self.problems {
            writeln!(f, "{problem}")?;
        }
        Ok(())
    }
}

/// Lines with their labels.
#[derive(Default)]
struct Page(Vec<(&'static str, String)>);

impl Page {
    fn add(&mut self, label: &'static str, text: impl Into<String>) {
        self.0.push((label, text.into()));
    }
}

impl DatasetReport {
    fn add_views(&self, page: &mut Page) {
        page.add("format", &self.recognised);
        let n = self.views;
        let counts = format!("{} train, {} val, {} test", n.train, n.val, n.test);
        page.add("views", counts);
        if !self.split_rule.is_empty() {
            page.add("split", &self.split_rule);
        }
        for r in &self.resolutions {
            let kind = if self.hdr { "linear" } else { "sRGB" };
            let text = format!("{} x {} px, {kind}, {} views", r.width, r.height, r.n_views);
            page.add("photos", text);
        }
        if !self.environment_visible {
            page.add("background", "not visible (cut-out photos)");
        }
    }

    fn add_cameras(&self, page: &mut Page) {
        let lens = &self.lens;
        let prefix = if lens.distorted { "" } else { "un" };
        let (focal, fov) = (span(lens.focal_px, 1), span(lens.fov_x_deg, 1));
        let text = format!("focal length {focal} px, {fov} degrees wide, {prefix}distorted");
        page.add("lens", text);
        let c = &self.cameras;
        let ([x, y, z], distance) = (c.look_at, span(c.distance, 3));
        let from = format!("{distance} units from ({x:.3}, {y:.3}, {z:.3})");
        page.add("cameras", format!("{from}, spread over {:.3}", c.extent));
        if let Some([x, y, z]) = self.up {
            let why = if self.up_is_given {
                "as given"
            } else {
                "as the cameras were held; --up says otherwise"
            };
            page.add("up", format!("({x:.3}, {y:.3}, {z:.3}), {why}"));
        }
        if let Some(points) = &self.points {
            let error = points.median_error_px;
            let error = error.map_or(String::new(), |e| format!(", seen to {e:.2} px (median)"));
            let (n, min, max) = (points.n_points, points.min, points.max);
            let text = format!("{n}{error}, nine tenths from {min:.3?} to {max:.3?}");
            page.add("points", text);
        }
    }

    fn add_object(&self, page: &mut Page) {
        let masks = self.masks.as_ref().map(|m| {
            let [mean, min, max] = [m.mean, m.min, m.max].map(|share| 100.0 * share);
            let covers = format!("object covers {mean:.1} % of the picture");
            format!("{} views; {covers} ({min:.1} to {max:.1} %)", m.n_views)
        });
        page.add("masks", masks.unwrap_or_else(|| "none".to_owned()));
        let mesh = self.mesh.as_ref().map(|m| {
            let closed = if m.watertight { "watertight" } else { "open" };
            let size = format!("{} vertices, {} triangles", m.n_vertices, m.n_triangles);
            format!("{size}, {closed}, from {:.3?} to {:.3?}", m.min, m.max)
        });
        page.add("mesh", mesh.unwrap_or_else(|| "none".to_owned()));
        if let Some(a) = &self.agreement {
            let worst = format!("worst {:.3}, view {}", a.worst_iou, a.worst_view);
            page.add(
                "fit",
                format!("mesh over masks {:.3} ({worst})", a.mean_iou),
            );
        }
    }

    fn add_conditions(&self, page: &mut Page) {
        let c = &self.conditions;
        let (circle, directions) = (c.circle_covered_deg, 100.0 * c.directions_seen);
        let around = format!("from {circle:.0} of 360 degrees around the object");
        page.add(
            "taken",
            format!("{around}, looking into {directions:.0} % of all directions"),
        );
        let stops = |what: &str, ev: Option<f32>| ev.map(|ev| format!("{ev:.2} stops {what}"));
        let known = [
            stops("apart from neighbouring photos", c.exposure_jitter_ev),
            stops("from least to most by EXIF", c.noted_exposure_range_ev),
        ];
        let known: Vec<String> = known.into_iter().flatten().collect();
        if !known.is_empty() {
            page.add("exposure", known.join(", "));
        }
        if let Some(share) = c.same_background {
            let share = 100.0 * share;
            let text = format!("the same in {share:.0} % of photos from different sides");
            page.add("background", text);
        }
    }
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
