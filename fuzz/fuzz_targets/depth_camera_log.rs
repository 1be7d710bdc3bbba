#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| neif_fuzz::load_with(
    "trajectory.log",
    bytes,
    &[("intrinsics.txt", b"50 50 20 15")]
));
