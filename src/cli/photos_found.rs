//! What a run found out about its photos, in words and for scripts.

use neif::train::session::saved::run_log::RunLog;
use serde_json::{Value, json};

/// How the photos' exposures, a gain a colour each, lie about their mean.
pub(crate) fn exposures_told(gains: impl Iterator<Item = [f32; 3]>) -> String {
    let stops = gains.flat_map(|gain| gain.map(f32::log2));
    let (least, most) = stops.fold((0.0_f32, 0.0_f32), |(least, most), ev| {
        (least.min(ev), most.max(ev))
    });
    format!("exposures of the photos: {least:+.2} to {most:+.2} stops from their mean")
}

/// By how many pixels the photos' cameras are corrected; none where they are left as given.
pub(crate) fn poses_told(moved_px: &[f32]) -> Option<String> {
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
    pub(crate) told: Vec<String>,
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
        let exposures = listed("exposures", "photos");
        let poses = listed("poses", "photos");
        let told = listed("loaded", "found");
        let mut told: Vec<String> = told
            .iter()
            .filter_map(|line| Some(line.as_str()?.to_owned()))
            .collect();
        let gains: Vec<[f32; 3]> = exposures.iter().filter_map(gain_of).collect();
        if !gains.is_empty() {
            told.push(exposures_told(gains.into_iter()));
        }
        let moved: Vec<f32> = poses.iter().filter_map(moved_of).collect();
        told.extend(poses_told(&moved));
        let names = if exposures.is_empty() {
            &poses
        } else {
            &exposures
        };
        let photo = |(i, named): (usize, &Value)| {
            let mut photo = json!({"name": named["name"]});
            if let Some(gain) = exposures.get(i) {
                photo["gain"] = gain["gain"].clone();
            }
            if let Some(pose) = poses.get(i) {
                photo["moved_px"] = pose["moved_px"].clone();
            }
            photo
        };
        Self {
            photos: names.iter().enumerate().map(photo).collect(),
            told,
        }
    }
}

fn gain_of(photo: &Value) -> Option<[f32; 3]> {
    let gain: Vec<f32> = photo["gain"]
        .as_array()?
        .iter()
        .filter_map(number)
        .collect();
    gain.try_into().ok()
}

fn moved_of(photo: &Value) -> Option<f32> {
    number(&photo["moved_px"])
}

fn number(value: &Value) -> Option<f32> {
    Some(value.as_f64()? as f32)
}

#[cfg(test)]
mod tests {
    use neif::train::session::events::TrainEvent;

    use super::*;

    #[test]
    fn a_log_tells_of_each_photo_what_the_end_of_the_run_found() {
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
            found.told,
            [
                "outlines are uncertain",
                "exposures of the photos: +0.00 to +1.00 stops from their mean",
                "poses of the photos: 0.75 pixels corrected in the median, 0.75 at most",
            ]
        );
    }
}
