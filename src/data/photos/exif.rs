//! The exposure that a camera noted in a photo's file (EXIF 2.3, tags of the Exif directory).

use std::path::Path;

use super::orientation::metadata_of;

/// The tag that points to the Exif directory.
const EXIF_DIRECTORY: u32 = 0x8769;
const EXPOSURE_TIME: u32 = 0x829A;
const F_NUMBER: u32 = 0x829D;
const SENSITIVITY: u32 = 0x8827;
const SHORT: u32 = 3;
const LONG: u32 = 4;
const RATIONAL: u32 = 5;

/// How much light a photo got, in stops: `log2(seconds * ISO / f²)`; `None` where the file does not say.
pub(in crate::data) fn exposure_ev(path: &Path) -> Option<f32> {
    let exif = metadata_of(path)?;
    // JPEG's segment begins with a name that not every reader takes off.
    exposure_in(exif.strip_prefix(b"Exif\0\0").unwrap_or(&exif))
}

fn exposure_in(tiff: &[u8]) -> Option<f32> {
    let reader = Tiff::new(tiff)?;
    let at = reader.value(reader.long(4)? as usize, EXIF_DIRECTORY)? as usize;
    let seconds = reader.value(at, EXPOSURE_TIME)?;
    // Phones have one aperture and may not note it.
    let f_number = reader.value(at, F_NUMBER).unwrap_or(1.0);
    let sensitivity = reader.value(at, SENSITIVITY).unwrap_or(100.0);
    let stops = (seconds * sensitivity / (f_number * f_number)).log2() as f32;
    stops.is_finite().then_some(stops)
}

/// Numbers in the blocks of a TIFF file.
struct Tiff<'a> {
    bytes: &'a [u8],
    is_big_endian: bool,
}

impl<'a> Tiff<'a> {
    fn new(bytes: &'a [u8]) -> Option<Self> {
        let is_big_endian = match bytes.get(..4)? {
            b"II*\0" => false,
            b"MM\0*" => true,
            _ => return None,
        };
        Some(Self {
            bytes,
            is_big_endian,
        })
    }

    /// The first number of an entry of the directory at `at`.
    fn value(&self, at: usize, tag: u32) -> Option<f64> {
        let n_entries = self.short(at)? as usize;
        let entry = (0..n_entries)
            .map(|i| at.saturating_add(2 + 12 * i))
            .find(|entry| self.short(*entry) == Some(tag))?;
        let content = entry.checked_add(8)?;
        match self.short(entry.checked_add(2)?)? {
            SHORT => self.short(content).map(f64::from),
            LONG => self.long(content).map(f64::from),
            RATIONAL => {
                let at = self.long(content)? as usize;
                let below = f64::from(self.long(at.checked_add(4)?)?);
                let above = f64::from(self.long(at)?);
                (below > 0.0).then(|| above / below)
            }
            _ => None,
        }
    }

    fn short(&self, at: usize) -> Option<u32> {
        self.number(at, 2)
    }

    fn long(&self, at: usize) -> Option<u32> {
        self.number(at, 4)
    }

    fn number(&self, at: usize, n_bytes: usize) -> Option<u32> {
        let bytes = self.bytes.get(at..at.checked_add(n_bytes)?)?;
        let add = |sum: u32, byte: &u8| sum << 8 | u32::from(*byte);
        Some(if self.is_big_endian {
            bytes.iter().fold(0, add)
        } else {
            bytes.iter().rev().fold(0, add)
        })
    }
}

#[cfg(test)]
pub(in crate::data) mod tests {
    use super::*;

    /// EXIF of a photo that was exposed `seconds` long at f/2 and ISO 200.
    pub(in crate::data) fn exif_of(seconds: (u32, u32)) -> Vec<u8> {
        let mut bytes = b"II*\0\x08\0\0\0".to_vec();
        let entry = |bytes: &mut Vec<u8>, tag: u32, kind: u32, value: u32| {
            bytes.extend(
                [tag as u16, kind as u16]
                    .map(u16::to_le_bytes)
                    .as_flattened(),
            );
            bytes.extend(1_u32.to_le_bytes());
            bytes.extend(value.to_le_bytes());
        };
        bytes.extend(1_u16.to_le_bytes());
        entry(&mut bytes, EXIF_DIRECTORY, LONG, 26);
        bytes.extend([0; 4]);
        bytes.extend(3_u16.to_le_bytes());
        entry(&mut bytes, EXPOSURE_TIME, RATIONAL, 68);
        entry(&mut bytes, F_NUMBER, RATIONAL, 76);
        entry(&mut bytes, SENSITIVITY, SHORT, 200);
        bytes.extend([0; 4]);
        for number in [seconds.0, seconds.1, 2, 1] {
            bytes.extend(number.to_le_bytes());
        }
        bytes
    }

    #[test]
    fn the_noted_exposure_is_read_and_broken_notes_are_none() {
        let whole = exif_of((1, 50));
        let stops = exposure_in(&whole).unwrap();
        assert!(stops.abs() < 1e-6, "1/50 s, f/2, ISO 200: {stops}");
        for n in 0..whole.len() - 8 {
            assert_eq!(exposure_in(&whole[..n]), None, "the first {n} bytes");
        }
        assert_eq!(exposure_in(&exif_of((0, 1))), None, "no time");
        assert_eq!(exposure_in(&exif_of((1, 0))), None, "no number");
    }
}
