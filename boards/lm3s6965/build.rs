//! Puts `memory.x` from the top of the checkout where the linker looks for it, and turns the
//! numbers of `board.toml` into constants.

fn main() {
    board_settings::write();
    board_settings::linker_script("../../memory.x");
    // Of functions that are the same, instruction by instruction, the robot's firmware has one.
    // Nothing compares addresses of functions. What is measured is linked plainly.
    println!("cargo:rustc-link-arg-bin=rover=--icf=all");
}
