//! What a device needs to know of a mission's link.

use esm_core::tables::Tables;

use crate::inspect::link_name;

/// A link in a blob.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WiredLink {
    /// Its name.
    pub name: String,
    /// Bits a second.
    pub rate_bps: u32,
    /// Bits that a byte takes.
    pub bits: u8,
}

impl WiredLink {
    /// The links of a mission, in their order.
    pub(super) fn of(tables: &Tables<'_>) -> Vec<Self> {
        let links = tables.links().iter().map(|link| WiredLink {
            name: link_name(tables, link),
            rate_bps: link.rate_bps.get(),
            // A byte of the record.
            bits: link.bits() as u8,
        });
        links.collect()
    }
}
