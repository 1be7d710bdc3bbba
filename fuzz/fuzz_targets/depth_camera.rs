#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| neif_fuzz::load_with(
    "pose/0000.txt",
    bytes,
    &[("intrinsics.txt", b"50 0 20 0 50 15 0 0 1")]
));
