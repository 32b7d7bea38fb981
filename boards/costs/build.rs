//! Puts the memory of the machine with this core where the linker looks for it.

use std::path::PathBuf;
use std::{env, fs};

/// A machine's memory: where flash and RAM begin, and how much is there, in KiB.
type Memory = [(u32, u32); 2];

/// The memory of the machine of QEMU's that has the core of a target; of a large one, a part.
fn memory(target: &str) -> Option<Memory> {
    match target {
        // microbit
        "thumbv6m-none-eabi" => Some([(0, 256), (0x2000_0000, 16)]),
        // lm3s6965evb
        "thumbv7m-none-eabi" => Some([(0, 256), (0x2000_0000, 64)]),
        // mps2-an386
        "thumbv7em-none-eabihf" => Some([(0, 256), (0x2000_0000, 64)]),
        // mps2-an505
        "thumbv8m.main-none-eabihf" => Some([(0x1000_0000, 256), (0x3800_0000, 64)]),
        _ => None,
    }
}

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    let target = env::var("TARGET").expect("cargo sets its variables");
    let Some([flash, ram]) = memory(&target) else {
        println!(
            "cargo::error=there is no machine for {target}: build.rs has those that there are"
        );
        return;
    };
    let line = |name: &str, (from, kib): (u32, u32)| {
        format!("  {name} : ORIGIN = {from:#x}, LENGTH = {kib}K\n")
    };
    let script = format!(
        "MEMORY\n{{\n{}{}}}\n",
        line("FLASH", flash),
        line("RAM", ram)
    );
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets its variables"));
    fs::write(out.join("memory.x"), script).expect("OUT_DIR can be written to");
    println!("cargo:rustc-link-search={}", out.display());
}
