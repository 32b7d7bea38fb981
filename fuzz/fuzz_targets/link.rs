//! `esm_tests::fuzzing::link` under libFuzzer.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| esm_tests::fuzzing::link(bytes));
