//! What the pixels have shown before training, and what is done about it, as sentences for people.

use super::store::PixelStore;
use crate::train::priors::depth_evidence::SeenDepths;

impl PixelStore {
    /// What was found in the photos.
    pub(in crate::train) fn findings(&self) -> Vec<String> {
        let mut findings = Vec::new();
        let error_px = self.outline_error_px();
        if error_px > 0.0 {
            findings.push(format!(
                "the masks' outlines are uncertain by {error_px:.1} pixels: beside them the mesh decides what is object"
            ));
        }
        let share = self.depths.as_ref().map_or(0.0, SeenDepths::share);
        if share > 0.0 {
            findings.push(format!(
                "how far away the background is was found before training in {:.0} % of the photos' pixels",
                100.0 * share
            ));
        }
        let n = self.n_sharing_chroma();
        if n > 0 {
            findings.push(format!(
                "{n} photos store colour more coarsely than brightness (JPEG): of the object, its mean over blocks of pixels is compared"
            ));
        }
        findings
    }
}
