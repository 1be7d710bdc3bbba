#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| neif_fuzz::load_with(
    "camera_intrinsic.json",
    bytes,
    &[("pose/0000.txt", b"1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1")]
));
