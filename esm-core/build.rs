//! Says what the interpreter is made for: `small` if it is compiled for size (opt-level "s" or "z"), or if the feature of that name asks for it.

use std::env;

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rustc-check-cfg=cfg(small)");
    let for_size = env::var("OPT_LEVEL").is_ok_and(|level| matches!(level.as_str(), "s" | "z"));
    if for_size || env::var_os("CARGO_FEATURE_SMALL").is_some() {
        println!("cargo:rustc-cfg=small");
    }
}
