#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| neif_fuzz::load_with(
    "sparse/images.txt",
    bytes,
    &[("sparse/cameras.txt", b"7 PINHOLE 40 30 50 50 20 15\n")]
));
