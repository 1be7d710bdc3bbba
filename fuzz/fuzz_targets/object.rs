#![no_main]

use libfuzzer_sys::fuzz_target;
use neif::neif::SurfaceField;

fuzz_target!(|bytes: &[u8]| neif_fuzz::read_with("object.safetensors", bytes, SurfaceField::load));
