//! Checked access to the fields of a JSON object, with errors that say where they stand.

use std::path::Path;

use serde_json::Value;

use crate::data::DataError;
use crate::data::frame::is_side_px;

/// A JSON object with the place it stands at, for messages.
pub(in crate::data) struct Fields<'a> {
    pub(in crate::data) json: &'a Path,
    pub(in crate::data) frame: Option<usize>,
    pub(in crate::data) value: &'a Value,
}

impl<'a> Fields<'a> {
    pub(in crate::data) fn new(
        json: &'a Path,
        frame: impl Into<Option<usize>>,
        value: &'a Value,
    ) -> Self {
        Self {
            json,
            frame: frame.into(),
            value,
        }
    }

    pub(in crate::data) fn error(&self, field: &str, problem: impl Into<String>) -> DataError {
        DataError::field(self.json, field, problem).in_frame(self.frame)
    }

    /// The field, where it is present and not null.
    fn get(&self, field: &str) -> Option<&Value> {
        self.value.get(field).filter(|value| !value.is_null())
    }

    pub(in crate::data) fn string(&self, field: &str) -> Result<Option<&str>, DataError> {
        self.get(field)
            .map(|value| {
                value
                    .as_str()
                    .ok_or_else(|| self.error(field, "not a text"))
            })
            .transpose()
    }

    pub(in crate::data) fn number(&self, field: &str) -> Result<Option<f32>, DataError> {
        self.get(field)
            .map(|value| {
                let number = value.as_f64().map(|v| v as f32).filter(|v| v.is_finite());
                number.ok_or_else(|| self.error(field, format!("{value} is not a finite number")))
            })
            .transpose()
    }

    fn number_that(
        &self,
        field: &str,
        wanted: &str,
        accept: impl Fn(f32) -> bool,
    ) -> Result<Option<f32>, DataError> {
        match self.number(field)? {
            Some(v) if !accept(v) => Err(self.error(field, format!("{v} is not {wanted}"))),
            number => Ok(number),
        }
    }

    pub(in crate::data) fn positive(&self, field: &str) -> Result<Option<f32>, DataError> {
        self.number_that(field, "greater than 0", |v| v > 0.0)
    }

    pub(in crate::data) fn angle(&self, field: &str) -> Result<Option<f32>, DataError> {
        let pi = std::f32::consts::PI;
        self.number_that(field, "an angle between 0 and pi", |v| v > 0.0 && v < pi)
    }

    /// A picture side; some files write `1080.0`.
    pub(in crate::data) fn side(&self, field: &str) -> Result<Option<u32>, DataError> {
        let side = self.number_that(field, "a picture size", |v| {
            is_side_px(v.into()) && v.fract() == 0.0
        })?;
        Ok(side.map(|v| v as u32))
    }
}
