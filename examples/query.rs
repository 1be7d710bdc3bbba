//! What light arrives at a point from a direction: `cargo run --release --example query ENVIRONMENT X,Y,Z X,Y,Z`.

use std::path::{Path, PathBuf};

use glam::Vec3;
use neif::neif::Environment;
use neif::neif::field::radiance_field::{FieldBatch, FieldRay};
use neif::neif::light::environment::LightScratch;

fn main() -> anyhow::Result<()> {
    let mut args = std::env::args().skip(1);
    let (Some(file), Some(at), Some(towards)) = (args.next(), args.next(), args.next()) else {
        anyhow::bail!("usage: query ENVIRONMENT X,Y,Z X,Y,Z");
    };
    let radiance = query(&PathBuf::from(file), vector(&at)?, vector(&towards)?)?;
    let mut out = std::io::stdout();
    std::io::Write::write_fmt(&mut out, format_args!("{radiance}\n"))?;
    Ok(())
}

fn vector(text: &str) -> anyhow::Result<Vec3> {
    let numbers: Vec<f32> = text.split(',').map(str::parse).collect::<Result<_, _>>()?;
    match numbers[..] {
        [x, y, z] => Ok(Vec3::new(x, y, z)),
        _ => anyhow::bail!("`{text}` is not X,Y,Z"),
    }
}

/// Linear radiance that arrives at the world point `at` from the direction `towards`: that of a trained environment, or of a
/// panorama.
pub(crate) fn query(file: &Path, at: Vec3, towards: Vec3) -> anyhow::Result<Vec3> {
    let environment = Environment::open(file)?;
    let origin = environment.frame().field_from_world(at).to_array();
    let direction = towards.normalize_or(Vec3::Z).to_array();
    let mut batch = FieldBatch::default();
    batch
        .rays
        .push(FieldRay::of_pixel(origin, direction, 0.0, 0.0));
    environment.light(&mut batch, &mut LightScratch::default());
    Ok(Vec3::from(batch.radiance[0]))
}
