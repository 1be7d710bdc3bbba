#![no_main]

use libfuzzer_sys::fuzz_target;
use neif::data::read_key_views;

fuzz_target!(|bytes: &[u8]| neif_fuzz::read_with("cameras.json", bytes, read_key_views));
