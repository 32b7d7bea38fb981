//! No flash: missions are gone with the power.

/// Nothing is written.
pub const LONGEST_MS: u16 = 0;

/// What is kept: nothing.
pub enum BoardStore {}

/// The memory of what the board keeps.
pub struct StoreMemory;

impl StoreMemory {
    /// None.
    #[allow(clippy::new_without_default, reason = "there is one, in a static")]
    pub const fn new() -> Self {
        StoreMemory
    }

    /// There is no flash.
    pub fn open(
        &'static mut self,
        _default_mission: Option<&'static [u8]>,
    ) -> Option<&'static mut BoardStore> {
        None
    }
}
