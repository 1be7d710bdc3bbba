//! `OpenEXR` pictures: colour or grey, half or float, read and written; named channels, written.
//!
//! Reads the first layer of a flat file; colour channels may carry a layer prefix
//! (`Combined.R`). Without all of R, G and B, a `Y` channel or an only channel becomes grey.

use std::path::Path;

use exr::compression::Compression;
use exr::image::{AnyChannel, AnyChannels, Blocks, Encoding, FlatSamples, Layer};
use exr::meta::MetaData;
use exr::meta::attribute::LineOrder;
use exr::meta::header::LayerAttributes;
use exr::prelude::{Image, ReadChannels as _, ReadLayers as _, WritableImage as _, f16, read};

use super::limits::{check_finite, check_size};
use crate::data::{DataError, write_atomically};

/// The most values of all channels that are read.
const MAX_SAMPLES: u64 = 512 << 20;

/// How a number is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExrSample {
    /// 16 bits; values beyond ±65504 are clamped there.
    Half,
    /// 32 bits.
    Float,
}

/// Reads an EXR: `(width, height, [height * width] RGB)`, scene-linear.
///
/// Errors on files without colour, deep files, NaN and infinite pixels.
pub fn read_exr_linear(path: &Path) -> Result<(u32, u32, Vec<[f32; 3]>), DataError> {
    let layer = read_layer(path)?;
    let [red, green, blue] = color_channels(path, &layer.channel_data)?;
    check_whole(path, &layer, &[red, green, blue])?;
    let pixels: Vec<[f32; 3]> = red
        .sample_data
        .values_as_f32()
        .zip(green.sample_data.values_as_f32())
        .zip(blue.sample_data.values_as_f32())
        .map(|((r, g), b)| [r, g, b])
        .collect();
    let (width, height) = (layer.size.0 as u32, layer.size.1 as u32);
    check_finite(path, width, &pixels)?;
    Ok((width, height, pixels))
}

/// Reads the depths of an EXR: its channel `Z`, `V`, `depth` or `distance`, else what would be red or grey.
pub(super) fn read_exr_depth(path: &Path) -> Result<(u32, u32, Vec<f32>), DataError> {
    const NAMES: [&str; 4] = ["Z", "V", "depth", "distance"];
    let layer = read_layer(path)?;
    let list = &layer.channel_data.list;
    let named = NAMES.iter().find_map(|name| channel(list, name));
    let depths = match named {
        Some(channel) => channel,
        None => color_channels(path, &layer.channel_data)?[0],
    };
    check_whole(path, &layer, &[depths])?;
    let (width, height) = (layer.size.0 as u32, layer.size.1 as u32);
    Ok((width, height, depths.sample_data.values_as_f32().collect()))
}

/// The first layer of a flat file of a size that is supported.
fn read_layer(path: &Path) -> Result<Layer<AnyChannels<FlatSamples>>, DataError> {
    let unreadable = |e| unreadable(path, e);
    let meta = MetaData::read_from_file(path, false).map_err(unreadable)?;
    for header in &meta.headers {
        let (width, height) = (header.layer_size.0 as u64, header.layer_size.1 as u64);
        check_size(path, width, height)?;
        let n_channels = header.channels.list.len();
        if width * height * n_channels as u64 > MAX_SAMPLES {
            let problem = format!(
                "{n_channels} channels of {width} x {height} pixels; at most {} million values are supported",
                MAX_SAMPLES >> 20
            );
            return Err(DataError::unusable(path, problem));
        }
    }
    let file = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .from_file(path)
        .map_err(unreadable)?;
    Ok(file.layer_data)
}

/// Refuses channels with fewer values than the layer has pixels.
fn check_whole(
    path: &Path,
    layer: &Layer<AnyChannels<FlatSamples>>,
    channels: &[&AnyChannel<FlatSamples>],
) -> Result<(), DataError> {
    let n_pixels = layer.size.0 * layer.size.1;
    if channels.iter().all(|c| c.sample_data.len() == n_pixels) {
        return Ok(());
    }
    let problem = "subsampled channels are not supported";
    Err(DataError::unusable(path, problem))
}

/// The channel of that name, behind any layer's prefix, in upper or lower case.
fn channel<'a>(
    list: &'a [AnyChannel<FlatSamples>],
    name: &str,
) -> Option<&'a AnyChannel<FlatSamples>> {
    list.iter().find(|channel| {
        let full = channel.name.to_string();
        let last = full.rsplit('.').next();
        last.is_some_and(|last| last.eq_ignore_ascii_case(name))
    })
}

/// Width and height of an EXR's first layer, from its header alone.
pub(super) fn exr_size(path: &Path) -> Result<(u32, u32), DataError> {
    let meta = MetaData::read_from_file(path, false).map_err(|e| unreadable(path, e))?;
    let header = meta.headers.first();
    let header = header.ok_or_else(|| DataError::unusable(path, "no layer is in it"))?;
    let side = |side: usize| u32::try_from(side).unwrap_or(u32::MAX);
    Ok((side(header.layer_size.0), side(header.layer_size.1)))
}

fn unreadable(path: &Path, error: exr::error::Error) -> DataError {
    match error {
        exr::error::Error::Io(source) => DataError::io(path, source),
        other => DataError::unusable(path, format!("cannot be decoded: {other}")),
    }
}

/// The channels to take as red, green and blue.
fn color_channels<'a>(
    path: &Path,
    channels: &'a AnyChannels<FlatSamples>,
) -> Result<[&'a AnyChannel<FlatSamples>; 3], DataError> {
    let list = &channels.list;
    let named = |wanted: &str| channel(list, wanted);
    if let (Some(r), Some(g), Some(b)) = (named("R"), named("G"), named("B")) {
        return Ok([r, g, b]);
    }
    let only = if list.len() == 1 { list.first() } else { None };
    if let Some(grey) = named("Y").or(only) {
        return Ok([grey; 3]);
    }
    let names: Vec<String> = list.iter().map(|c| c.name.to_string()).collect();
    let problem = format!("no channels R, G, B or Y, but {}", names.join(", "));
    Err(DataError::unusable(path, problem))
}

/// Writes linear colours as an RGB EXR, compressed quickly, atomically.
///
/// `pixels_linear`: `[height * width]`, row-major. Panics if the count is wrong.
pub fn write_exr(
    path: &Path,
    width: u32,
    height: u32,
    pixels_linear: &[[f32; 3]],
    sample: ExrSample,
) -> Result<(), DataError> {
    let channel = |(i, name): (usize, &str)| ExrChannel {
        name: name.to_owned(),
        values: pixels_linear.iter().map(|color| color[i]).collect(),
        sample,
    };
    let channels = ["R", "G", "B"].into_iter().enumerate().map(channel);
    let channels = channels.collect();
    write_channels(path, (width, height), channels, Encoding::FAST_LOSSLESS)
}

/// One channel of a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct ExrChannel {
    /// Its name: `R`, `G`, `B`, `A`, `Z`, or that of a layer's channel such as `diffuse.R`.
    pub name: String,
    /// `[height * width]`, row-major.
    pub values: Vec<f32>,
    /// How its numbers are stored.
    pub sample: ExrSample,
}

/// Writes named channels as one EXR, ZIP-compressed, atomically.
///
/// Panics if a channel has another number of values than the picture has pixels.
pub fn write_exr_channels(
    path: &Path,
    width: u32,
    height: u32,
    channels: Vec<ExrChannel>,
) -> Result<(), DataError> {
    let encoding = Encoding {
        compression: Compression::ZIP16,
        blocks: Blocks::ScanLines,
        line_order: LineOrder::Increasing,
    };
    write_channels(path, (width, height), channels, encoding)
}

fn write_channels(
    path: &Path,
    (width, height): (u32, u32),
    channels: Vec<ExrChannel>,
    encoding: Encoding,
) -> Result<(), DataError> {
    let size = (width as usize, height as usize);
    let stored = channels.into_iter().map(|channel| {
        assert_eq!(channel.values.len(), size.0 * size.1, "one value a pixel");
        // Without the clamp bright pixels would be stored as infinity.
        let half = |v: &f32| f16::from_f32(v.clamp(-65504.0, 65504.0));
        let samples = match channel.sample {
            ExrSample::Half => FlatSamples::F16(channel.values.iter().map(half).collect()),
            ExrSample::Float => FlatSamples::F32(channel.values),
        };
        AnyChannel::new(channel.name.as_str(), samples)
    });
    let channels = AnyChannels::sort(stored.collect());
    let layer = Layer::new(size, LayerAttributes::default(), encoding, channels);
    let image = Image::from_layer(layer);
    write_atomically(path, |file| {
        image
            .write()
            .to_buffered(file)
            .map_err(std::io::Error::other)
    })
    .map_err(|e| DataError::io(path, e))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::test_asserts::assert_error;

    #[test]
    fn written_pictures_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let pixels: Vec<[f32; 3]> = (0..15).map(|i| [i as f32, 0.1, 1e5]).collect();
        write_exr(&path, 5, 3, &pixels, ExrSample::Float).unwrap();
        assert_eq!(
            read_exr_linear(&path).unwrap(),
            (5, 3, pixels.clone()),
            "float"
        );
        write_exr(&path, 5, 3, &pixels, ExrSample::Half).unwrap();
        let (_, _, half) = read_exr_linear(&path).unwrap();
        assert_eq!((half[14][0], half[14][2]), (14.0, 65504.0), "half, clamped");
        assert!((half[0][1] - 0.1).abs() < 1e-4, "half, rounded");
    }

    #[test]
    fn named_channels_leave_the_colour_readable() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("layers.exr");
        let names = ["diffuse.R", "R", "Z", "G", "B", "A"];
        let channels = names.iter().enumerate().map(|(i, name)| ExrChannel {
            name: (*name).to_owned(),
            values: (0..15).map(|pixel| (i * 100 + pixel) as f32).collect(),
            sample: if *name == "Z" {
                ExrSample::Float
            } else {
                ExrSample::Half
            },
        });
        write_exr_channels(&path, 5, 3, channels.collect()).unwrap();
        let (width, height, pixels) = read_exr_linear(&path).unwrap();
        assert_eq!((width, height, pixels[14]), (5, 3, [114.0, 314.0, 414.0]));
        let meta = MetaData::read_from_file(&path, false).unwrap();
        let stored = meta.headers[0].channels.list.iter();
        let stored: Vec<_> = stored.map(|channel| channel.name.to_string()).collect();
        assert_eq!(stored, ["A", "B", "G", "R", "Z", "diffuse.R"]);
    }

    #[test]
    fn nan_and_infinite_pixels_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("bad.exr");
        for bad in [f32::NAN, f32::INFINITY] {
            let mut pixels = vec![[0.5; 3]; 15];
            pixels[7][1] = bad;
            write_exr(&path, 5, 3, &pixels, ExrSample::Float).unwrap();
            assert_error(read_exr_linear(&path), &["bad.exr", "(2, 1)"]);
        }
    }

    #[test]
    fn truncated_files_are_errors() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        write_exr(&path, 5, 3, &[[0.5; 3]; 15], ExrSample::Float).unwrap();
        let whole = std::fs::read(&path).unwrap();
        for length in [0, 10, whole.len() / 2, whole.len() - 4] {
            std::fs::write(&path, &whole[..length]).unwrap();
            assert!(read_exr_linear(&path).is_err(), "{length} bytes");
        }
    }
}
