#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| neif_fuzz::load_with(
    "sparse/images.bin",
    bytes,
    &[("sparse/cameras.bin", "\0\0\0\0\0\0\0\0")]
));
