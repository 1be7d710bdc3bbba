#![no_main]

use libfuzzer_sys::fuzz_target;
use neif::neif::Environment;

fuzz_target!(|bytes: &[u8]| neif_fuzz::read_with(
    "environment.safetensors",
    bytes,
    Environment::load
));
