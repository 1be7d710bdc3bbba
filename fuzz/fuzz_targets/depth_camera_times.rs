#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| neif_fuzz::load_with(
    "groundtruth.txt",
    bytes,
    &[
        ("intrinsics.txt", b"50 50 20 15"),
        ("rgb.txt", b"1000 color/0000.png\n1000.5 color/0001.png\n")
    ]
));
