//! Puts what the linker scripts of both chips have in common where the linker looks for it.

fn main() {
    board_settings::linker_script("rp.x");
}
