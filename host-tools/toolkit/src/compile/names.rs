//! The name table; its order stands in [`esm_core::format`].

use super::layout::Layout;
use crate::model::Model;

/// Writes the names of events, containers, control flags, regions, states and exclusive groups.
pub(super) fn write(model: &Model, layout: &Layout, groups: &[String]) -> Vec<u8> {
    let mut names = Vec::new();
    for event in &layout.events {
        append(&mut names, &model.events[*event]);
    }
    for (_, declared) in layout.with_models(model) {
        append(&mut names, &declared.name);
        for flag in &declared.flags {
            append(&mut names, &flag.name);
        }
        for region in &declared.regions {
            append(&mut names, &region.name);
            for state in &region.states {
                append(&mut names, &state.name);
            }
        }
    }
    for group in groups {
        append(&mut names, group);
    }
    names
}

/// Appends a postcard varint with the length, and the text.
fn append(names: &mut Vec<u8>, name: &str) {
    let mut length = name.len();
    while length >= 0x80 {
        names.push(length as u8 | 0x80);
        length >>= 7;
    }
    names.push(length as u8);
    names.extend_from_slice(name.as_bytes());
}
