//! What a run found out about its photos, in words and for scripts.

use neif::train::session::saved::run_log::RunLog;
use serde::de::DeserializeOwned;
use serde_json::Value;

/// How the photos' exposures, a gain a colour each, lie about their mean.
pub(crate) fn describe_exposures(gains: impl Iterator<Item = [f32; 3]>) -> String {
    let stops = gains.flat_map(|gain| gain.map(f32::log2));
    let (least, most) = stops.fold((0.0_f32, 0.0_f32), |(least, most), ev| {
        (least.min(ev), most.max(ev))
    });
    format!("exposures of the photos: {least:+.2} to {most:+.2} stops from their mean")
}

/// By how many pixels the photos' cameras are corrected; none where they are left as given.
pub(crate) fn describe_poses(moved_px: &[f32]) -> Option<String> {
    let mut moved = moved_px.to_vec();
    moved.sort_by(f32::total_cmp);
    let (median, most) = (moved.get(moved.len() / 2)?, moved.last()?);
    Some(format!(
        "poses of the photos: {median:.2} pixels corrected in the median, {most:.2} at most"
    ))
}

/// The photos of a run, each with what was found of it.
#[derive(Debug, Default)]
pub(crate) struct PhotosFound {
    /// Lines for people.
    pub(crate) lines: Vec<String>,
    /// `{name, gain, moved_px}` each; what was not found is missing.
    pub(crate) photos: Vec<Value>,
}

impl PhotosFound {
    /// What the log of a run says.
    pub(crate) fn of(log: &RunLog) -> Self {
        let listed = |event: &str, key: &str| match log.last_event(event).map(|e| e[key].clone()) {
            Some(Value::Array(list)) => list,
            _ => Vec::new(),
        };
        let (exposures, poses) = (listed("exposures", "photos"), listed("poses", "photos"));
        let found = listed("loaded", "found");
        let mut lines: Vec<String> = found
            .iter()
            .filter_map(|line| Some(line.as_str()?.to_owned()))
            .collect();
        let gains: Vec<[f32; 3]> = numbers(&exposures, "gain");
        if !gains.is_empty() {
            lines.push(describe_exposures(gains.into_iter()));
        }
        lines.extend(describe_poses(&numbers(&poses, "moved_px")));
        let mut photos = if exposures.is_empty() {
            poses.clone()
        } else {
            exposures
        };
        for (photo, pose) in photos.iter_mut().zip(&poses) {
            photo["moved_px"] = pose["moved_px"].clone();
        }
        Self { lines, photos }
    }
}

/// What each photo has under `key`, where it can be read.
fn numbers<T: DeserializeOwned>(photos: &[Value], key: &str) -> Vec<T> {
    let values = photos.iter().map(|photo| T::deserialize(&photo[key]));
    values.flatten().collect()
}

#[cfg(test)]
mod tests {
    use neif::train::session::events::TrainEvent;
    use serde_json::json;

    use super::*;

    #[test]
    fn a_log_has_of_each_photo_what_the_end_of_the_run_found() {
        let mut log = RunLog::default();
        assert!(PhotosFound::of(&log).photos.is_empty());
        log.note(&TrainEvent::Loaded {
            n_train: 2,
            n_val: 0,
            width: 4,
            height: 4,
            has_object: true,
            problems: vec!["odd".to_owned()],
            found: vec!["outlines are uncertain".to_owned()],
        });
        let named = |name: &str| name.to_owned();
        log.note(&TrainEvent::Poses(vec![
            (named("a"), 9.0),
            (named("b"), 9.0),
        ]));
        let gains = vec![(named("a"), [1.0; 3]), (named("b"), [2.0; 3])];
        log.note(&TrainEvent::Exposures(gains));
        log.note(&TrainEvent::Poses(vec![
            (named("a"), 0.5),
            (named("b"), 0.75),
        ]));
        let found = PhotosFound::of(&log);
        assert_eq!(
            found.photos,
            [
                json!({"name": "a", "gain": [1.0, 1.0, 1.0], "moved_px": 0.5}),
                json!({"name": "b", "gain": [2.0, 2.0, 2.0], "moved_px": 0.75}),
            ]
        );
        assert_eq!(
            found.lines,
            [
                "outlines are uncertain",
                "exposures of the photos: +0.00 to +1.00 stops from their mean",
                "poses of the photos: 0.75 pixels corrected in the median, 0.75 at most",
            ]
        );
    }
}
