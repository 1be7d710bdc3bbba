#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| neif_fuzz::load_with("cams/0000_cam.txt", bytes, &[]));
