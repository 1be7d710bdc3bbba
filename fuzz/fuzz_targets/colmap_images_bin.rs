#![no_main]

use libfuzzer_sys::fuzz_target;
use neif_fuzz::colmap;

fuzz_target!(|bytes: &[u8]| neif_fuzz::load_with(
    "sparse/images.bin",
    bytes,
    &[("sparse/cameras.bin", &colmap::cameras_bin())]
));
