#![no_main]
#[path = "../src/all.rs"]
mod all;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| all::bodies::positions(bytes));
