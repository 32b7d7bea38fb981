//! Puts `memory.x` where the linker looks for it, and turns the numbers of `board.toml` into
//! constants.

fn main() {
    board_settings::write();
    board_settings::linker_script("memory.x");
}
