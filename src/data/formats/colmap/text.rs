//! COLMAP's text files: a record a line (two for images), fields between blanks, `#` for comments.

use std::fs::File;
use std::io::{BufRead as _, BufReader, Read as _};
use std::path::Path;
use std::str::{FromStr, SplitWhitespace};

use glam::DVec3;

use super::model::{ColmapCamera, ColmapImage, ColmapPoint, KINDS, Observation};
use super::{Format, Keep};
use crate::data::DataError;

/// The longest line accepted, bytes: about a million observations.
const MAX_LINE: u64 = 64 << 20;

pub(super) const FORMAT: Format = Format {
    name: "text",
    extension: "txt",
    cameras: read_cameras,
    images: read_images,
    points: read_points,
};

fn read_cameras(path: &Path) -> Result<Vec<ColmapCamera>, DataError> {
    let mut lines = Lines::open(path)?;
    let mut cameras = Vec::new();
    while let Some(line) = lines.next_record()? {
        let mut fields = lines.fields(&line);
        let id = fields.parse("CAMERA_ID")?;
        let name = fields.text("MODEL")?;
        let Some(kind) = KINDS.iter().find(|kind| kind.name == name) else {
            return Err(lines.error("MODEL", format!("\"{name}\" is not a camera model")));
        };
        let size = [fields.parse("WIDTH")?, fields.parse("HEIGHT")?];
        let params = (0..kind.n_params())
            .map(|_| fields.number("PARAMS"))
            .collect::<Result<Vec<f64>, _>>()?;
        let camera = ColmapCamera::new(id, kind, size, &params);
        cameras.push(camera.map_err(|(field, problem)| lines.error(field, problem))?);
    }
    Ok(cameras)
}

fn read_images(path: &Path, keep: Keep) -> Result<Vec<ColmapImage>, DataError> {
    let mut lines = Lines::open(path)?;
    let mut images = Vec::new();
    while let Some(line) = lines.next_record()? {
        let mut fields = lines.fields(&line);
        let id = fields.parse("IMAGE_ID")?;
        let quaternion = fields.numbers("QW, QX, QY, QZ")?;
        let translation = DVec3::from_array(fields.numbers("TX, TY, TZ")?);
        let camera_id = fields.parse("CAMERA_ID")?;
        let name = fields.rest("NAME")?;
        let image = ColmapImage::new(id, camera_id, name, quaternion, translation);
        let mut image = image.map_err(|(field, problem)| lines.error(field, problem))?;
        // The line of features is there even when it is empty, but editors strip the last one.
        let observations = lines.next_line()?.unwrap_or_default();
        if keep == Keep::Observations {
            image.observations = parse_observations(&lines, &observations)?;
        }
        images.push(image);
    }
    Ok(images)
}

fn parse_observations(lines: &Lines<'_>, line: &str) -> Result<Vec<Observation>, DataError> {
    let mut fields = lines.fields(line);
    let mut observations = Vec::new();
    while let Some(x) = fields.words.next() {
        observations.push(Observation {
            x_px: fields.parse_word("POINTS2D", x)?,
            y_px: fields.number("POINTS2D")?,
            point_id: u64::try_from(fields.parse::<i64>("POINTS2D")?).ok(),
        });
    }
    Ok(observations)
}

fn read_points(path: &Path) -> Result<Vec<ColmapPoint>, DataError> {
    let mut lines = Lines::open(path)?;
    let mut points = Vec::new();
    while let Some(line) = lines.next_record()? {
        let mut fields = lines.fields(&line);
        let mut point = ColmapPoint {
            id: fields.parse("POINT3D_ID")?,
            position: DVec3::from_array(fields.numbers("X, Y, Z")?),
            color: [fields.parse("R")?, fields.parse("G")?, fields.parse("B")?],
            error_px: fields.parse("ERROR")?,
            seen_by: Vec::new(),
        };
        while let Some(image) = fields.words.next() {
            point.seen_by.push(fields.parse_word("TRACK", image)?);
            // The number of the feature in that image.
            fields.parse::<i64>("TRACK")?;
        }
        points.push(point);
    }
    Ok(points)
}

/// The lines of a text file, counted for messages.
struct Lines<'a> {
    path: &'a Path,
    reader: BufReader<File>,
    number: usize,
}

impl<'a> Lines<'a> {
    fn open(path: &'a Path) -> Result<Self, DataError> {
        let file = File::open(path).map_err(|e| DataError::io(path, e))?;
        Ok(Self {
            path,
            reader: BufReader::new(file),
            number: 0,
        })
    }

    fn error(&self, field: &str, problem: impl Into<String>) -> DataError {
        DataError::field(self.path, format!("line {}, {field}", self.number), problem)
    }

    /// The next line as it stands, without its end.
    fn next_line(&mut self) -> Result<Option<String>, DataError> {
        let mut bytes = Vec::new();
        let n_read = (&mut self.reader)
            .take(MAX_LINE)
            .read_until(b'\n', &mut bytes)
            .map_err(|e| DataError::io(self.path, e))?;
        if n_read == 0 {
            return Ok(None);
        }
        self.number += 1;
        if n_read as u64 == MAX_LINE {
            return Err(self.error("length", "the line is too long"));
        }
        let text = String::from_utf8(bytes).map_err(|_not_utf8| self.error("text", "not UTF-8"))?;
        Ok(Some(text.trim_end_matches(['\n', '\r']).to_owned()))
    }

    /// The next line that is neither empty nor a comment.
    fn next_record(&mut self) -> Result<Option<String>, DataError> {
        while let Some(line) = self.next_line()? {
            let start = line.trim_start();
            if !start.is_empty() && !start.starts_with('#') {
                return Ok(Some(line));
            }
        }
        Ok(None)
    }

    fn fields<'b>(&'b self, line: &'b str) -> Fields<'b> {
        Fields {
            lines: self,
            words: line.split_whitespace(),
        }
    }
}

/// The words of one line.
struct Fields<'a> {
    lines: &'a Lines<'a>,
    words: SplitWhitespace<'a>,
}

impl<'a> Fields<'a> {
    fn text(&mut self, field: &str) -> Result<&'a str, DataError> {
        self.words
            .next()
            .ok_or_else(|| self.lines.error(field, "the line ends here"))
    }

    fn parse_word<T: FromStr>(&self, field: &str, word: &str) -> Result<T, DataError> {
        word.parse().map_err(|_unparsed| {
            self.lines
                .error(field, format!("\"{word}\" is not such a number"))
        })
    }

    fn parse<T: FromStr>(&mut self, field: &str) -> Result<T, DataError> {
        let word = self.text(field)?;
        self.parse_word(field, word)
    }

    /// A number, which must be finite.
    fn number(&mut self, field: &str) -> Result<f64, DataError> {
        let value: f64 = self.parse(field)?;
        if value.is_finite() {
            Ok(value)
        } else {
            Err(self
                .lines
                .error(field, format!("{value} is not a finite number")))
        }
    }

    fn numbers<const N: usize>(&mut self, field: &str) -> Result<[f64; N], DataError> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.number(field)?;
        }
        Ok(values)
    }

    /// What is left of the line: names may hold blanks.
    fn rest(&mut self, field: &str) -> Result<String, DataError> {
        let words: Vec<&str> = self.words.by_ref().collect();
        if words.is_empty() {
            return Err(self.lines.error(field, "the line ends here"));
        }
        Ok(words.join(" "))
    }
}
