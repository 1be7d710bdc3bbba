//! What may be typed after a flag: durations, vectors, sizes, named files.

use std::path::PathBuf;

use glam::Vec3;
use neif::geometry::Aabb;
use neif::train::masks::Selection;

/// Reads `300s`, `5m`, `1.5h` or a bare number of seconds; more than zero.
pub(crate) fn duration_secs(text: &str) -> Result<f64, String> {
    let (number, unit) = match text.char_indices().find(|(_, c)| c.is_ascii_alphabetic()) {
        // An exponent (`1e3`) is no unit.
        Some((at, c)) if c != 'e' && c != 'E' => text.split_at(at),
        _ => (text, "s"),
    };
    let factor = match unit {
        "s" | "sec" => 1.0,
        "m" | "min" => 60.0,
        "h" => 3600.0,
        _ => return Err(format!("unknown unit `{unit}`; use s, m or h, as in 300s")),
    };
    let seconds = finite(number)?;
    let seconds = f64::from(seconds) * factor;
    if seconds > 0.0 {
        Ok(seconds)
    } else {
        Err("must be more than zero".to_owned())
    }
}

/// Reads a finite number.
pub(crate) fn finite(text: &str) -> Result<f32, String> {
    match text.trim().parse::<f32>() {
        Ok(value) if value.is_finite() => Ok(value),
        Ok(_) => Err("must be a finite number".to_owned()),
        Err(error) => Err(error.to_string()),
    }
}

/// Reads a number from 0 to 1.
pub(crate) fn unit_interval(text: &str) -> Result<f32, String> {
    match finite(text)? {
        value if (0.0..=1.0).contains(&value) => Ok(value),
        _ => Err("must be from 0 to 1".to_owned()),
    }
}

/// Reads a number that is not below zero.
pub(crate) fn not_negative(text: &str) -> Result<f32, String> {
    match finite(text)? {
        value if value >= 0.0 => Ok(value),
        _ => Err("must not be below zero".to_owned()),
    }
}

/// Reads a number above zero.
pub(crate) fn positive(text: &str) -> Result<f32, String> {
    match finite(text)? {
        value if value > 0.0 => Ok(value),
        _ => Err("must be more than zero".to_owned()),
    }
}

/// Reads `X,Y,Z`, three finite numbers.
pub(crate) fn vector(text: &str) -> Result<Vec3, String> {
    let numbers: Vec<f32> = text.split(',').map(finite).collect::<Result<_, _>>()?;
    match numbers[..] {
        [x, y, z] => Ok(Vec3::new(x, y, z)),
        _ => Err(format!(
            "expected three numbers as in 0,0,90, found {}",
            numbers.len()
        )),
    }
}

/// Reads `auto` or a point on the object.
pub(crate) fn selection(text: &str) -> Result<Selection, String> {
    let at = match text {
        "auto" => None,
        _ => Some(vector(text)?),
    };
    Ok(Selection {
        at,
        ..Selection::default()
    })
}

/// Reads `X,Y,Z,X,Y,Z`, two opposite corners of a box.
pub(crate) fn aabb(text: &str) -> Result<Aabb, String> {
    let numbers: Vec<f32> = text.split(',').map(finite).collect::<Result<_, _>>()?;
    match numbers[..] {
        [a, b, c, d, e, f] => Ok(Aabb::from_points([Vec3::new(a, b, c), Vec3::new(d, e, f)])),
        _ => Err(format!(
            "expected six numbers as in -1,-1,0,1,1,2, found {}",
            numbers.len()
        )),
    }
}

/// Reads a direction: `x`, `-y` and the like, or `X,Y,Z` of any length; gives a unit vector.
pub(crate) fn direction(text: &str) -> Result<Vec3, String> {
    let (sign, axis) = match text.strip_prefix('-') {
        Some(axis) => (-1.0, axis),
        None => (1.0, text.strip_prefix('+').unwrap_or(text)),
    };
    match axis {
        "x" | "X" => Ok(sign * Vec3::X),
        "y" | "Y" => Ok(sign * Vec3::Y),
        "z" | "Z" => Ok(sign * Vec3::Z),
        _ => vector(text)
            .map_err(|error| format!("not an axis (x, -y, ...), and as a vector: {error}"))?
            .try_normalize()
            .ok_or_else(|| "has no direction".to_owned()),
    }
}

/// Reads every how many-th photo tests: 0 for none, else 2 or more, so that some are left to learn from.
pub(crate) fn test_every(text: &str) -> Result<u32, String> {
    match text.parse::<u32>() {
        Ok(1) => Err("1 leaves no photo to learn from".to_owned()),
        Ok(every) => Ok(every),
        Err(error) => Err(error.to_string()),
    }
}

/// Reads `R,G,B`, none below zero.
pub(crate) fn colour(text: &str) -> Result<Vec3, String> {
    let colour = vector(text)?;
    if colour.min_element() < 0.0 {
        return Err("colours must not be below zero".to_owned());
    }
    Ok(colour)
}

/// Reads `R,G,B` or one number for all three, none below zero.
pub(crate) fn gain(text: &str) -> Result<Vec3, String> {
    if text.contains(',') {
        colour(text)
    } else {
        not_negative(text).map(Vec3::splat)
    }
}

/// The largest side that is rendered: beyond it a typing error is likelier than a wish.
const MAX_SIDE_PX: u32 = 16384;

/// Reads `WxH`, e.g. `1280x720`: width and height of a picture in pixels.
pub(crate) fn size(text: &str) -> Result<(u32, u32), String> {
    let sides = text
        .split_once(['x', 'X'])
        .ok_or("expected WxH, e.g. 1280x720")?;
    let side = |text: &str| match text.parse::<u32>() {
        Ok(side) if (1..=MAX_SIDE_PX).contains(&side) => Ok(side),
        Ok(_) => Err(format!("sides must be from 1 to {MAX_SIDE_PX}")),
        Err(error) => Err(format!("`{text}`: {error}")),
    };
    Ok((side(sides.0)?, side(sides.1)?))
}

/// Reads `NAME=FILE`.
pub(crate) fn named_path(text: &str) -> Result<(String, PathBuf), String> {
    match text.split_once('=') {
        Some((name, path)) if !name.is_empty() && !path.is_empty() => {
            Ok((name.to_owned(), PathBuf::from(path)))
        }
        _ => Err("expected NAME=FILE".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_have_units() {
        assert_eq!(duration_secs("300s"), Ok(300.0));
        assert_eq!(duration_secs("300"), Ok(300.0));
        assert_eq!(duration_secs("1.5m"), Ok(90.0));
        assert_eq!(duration_secs("1e2"), Ok(100.0));
        for bad in ["", "s", "-5s", "0s", "nan", "inf", "5 parsecs", "5d"] {
            assert!(duration_secs(bad).is_err(), "`{bad}` must be refused");
        }
    }

    #[test]
    fn vectors_take_exactly_three_finite_numbers() {
        assert_eq!(vector("0,-1.5,90"), Ok(Vec3::new(0.0, -1.5, 90.0)));
        for bad in ["", "1,2", "1,2,3,4", "1,2,nan", "a,b,c"] {
            assert!(vector(bad).is_err(), "`{bad}` must be refused");
        }
        assert!(colour("1,-1,0").is_err(), "colours are not negative");
        assert_eq!(gain("2"), Ok(Vec3::splat(2.0)));
    }

    #[test]
    fn directions_are_axes_or_vectors() {
        assert_eq!(direction("-y"), Ok(Vec3::NEG_Y));
        assert_eq!(direction("Z"), Ok(Vec3::Z));
        assert_eq!(direction("0,-2,0"), Ok(Vec3::NEG_Y));
        for bad in ["", "w", "0,0,0", "1,2", "--x"] {
            assert!(direction(bad).is_err(), "`{bad}` must be refused");
        }
    }

    #[test]
    fn sizes_are_bounded() {
        assert_eq!(size("1280x720"), Ok((1280, 720)));
        for bad in ["0x5", "5", "99999999x2", "x", "-1x4"] {
            assert!(size(bad).is_err(), "`{bad}` must be refused");
        }
    }

    #[test]
    fn named_paths_need_both_parts() {
        let named = named_path("a=b=c");
        assert_eq!(named, Ok(("a".to_owned(), PathBuf::from("b=c"))));
        assert!(named_path("gallery").is_err());
    }
}
