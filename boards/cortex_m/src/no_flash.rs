//! A firmware that keeps no missions: it is built without the feature `store`.

/// Nothing takes any time.
pub const LONGEST_MS: u16 = 0;

/// Nothing is kept.
pub enum BoardStore {}

/// The memory of what the board keeps: none.
pub struct StoreMemory;

impl StoreMemory {
    /// No memory.
    #[allow(clippy::new_without_default, reason = "there is one, in a static")]
    pub const fn new() -> Self {
        StoreMemory
    }
}

/// Nothing is kept.
pub fn open(
    _memory: &'static mut StoreMemory,
    _default_mission: Option<&'static [u8]>,
) -> Option<&'static mut BoardStore> {
    None
}
