//! Puts the memory of the emulator, or of a part of silicon, where the linker looks for it, and
//! turns the numbers of `board.toml` into constants.

fn main() {
    board_settings::write();
    board_settings::linker_script(match std::env::var_os("CARGO_FEATURE_EMULATION") {
        Some(_) => "memory/emulator/memory.x",
        None => "memory/part/memory.x",
    });
}
