//! What a board's crate is made of, as a macro: it has the board's settings, which are constants of
//! its build script.

/// Makes a board of this crate: its name, its settings, its flash, its line, and its first code.
/// To be called at the top of the board's crate, which has the build script's `settings.rs`:
///
/// ```ignore
/// pub use rp_board::*;
/// rp_board::board! { name: "pico", flash_bytes: 2 << 20 }
/// ```
///
/// The board has an `app!` of its own, which hands on to this crate's, and says which crate it is:
///
/// ```ignore
/// #[macro_export]
/// macro_rules! app {
///     ($($firmware:tt)*) => {
///         $crate::rp_board::app! { board($crate); $($firmware)* }
///     };
/// }
/// ```
#[macro_export]
macro_rules! board {
    (name: $name:literal, flash_bytes: $flash_bytes:expr $(,)?) => {
        /// Name of the board, as it tells it over the link.
        pub const NAME: &str = $name;

        /// What `board.toml` says, as constants.
        pub mod settings {
            include!(concat!(env!("OUT_DIR"), "/settings.rs"));
        }

        pub use settings::Memory;

        const _: () = assert!(
            settings::TICKS_PER_US == $crate::clock::TICKS_PER_US,
            "the timer counts microseconds"
        );

        /// The first code: see [`rp_board::start`].
        ///
        /// # Panics
        /// If it is called again, the crystal does not swing, or two parts have one pin.
        pub fn start<const SONARS: usize>(
            wiring: &$crate::wiring::Wiring<SONARS>,
        ) -> $crate::cortex_m_board::sides::Start<
            $crate::slots::SlotBoard,
            $crate::pins::Parts<SONARS>,
        > {
            $crate::start(concat!("esm robot on ", $name), wiring)
        }

        #[cfg(not(feature = "store"))]
        pub use $crate::cortex_m_board::no_flash as flash;
        /// The flash that missions are kept in: see [`rp_board::flash`].
        #[cfg(feature = "store")]
        pub mod flash {
            use $crate::flash;

            use super::settings::BLOB_BYTES;

            const FLASH_BYTES: u32 = $flash_bytes;

            /// The flash, and what is kept in it.
            pub type BoardStore = flash::BoardStore<FLASH_BYTES, BLOB_BYTES>;
            /// The memory of what the board keeps.
            pub type StoreMemory = flash::StoreMemory<FLASH_BYTES, BLOB_BYTES>;
            /// Milliseconds that it takes at most to keep a mission that is signed.
            pub const LONGEST_MS: u16 = flash::longest_ms(BLOB_BYTES);
            pub use flash::open;
        }

        /// The link's line: see [`rp_board::line`].
        pub mod line {
            use $crate::cortex_m_board::line::{self, LineBoard};
            use $crate::{clock, line as wires};

            use super::flash::{self, BoardStore};

            pub use line::{RECEIVE_BYTES, TRANSMIT_BYTES, split};

            /// What a line needs of this board.
            pub struct Wires;

            impl LineBoard for Wires {
                type Store = BoardStore;
                const FLASH_MS: u16 = flash::LONGEST_MS;

                fn now_us() -> u64 {
                    clock::now_us()
                }

                fn call_line() {
                    wires::call();
                }

                fn call_slots() {
                    clock::call();
                }
            }

            /// The interrupt handler's end.
            pub type Line = line::Line<Wires>;
            /// The link task's end.
            pub type LinkEnd = line::LinkEnd<Wires>;
        }
    };
}
