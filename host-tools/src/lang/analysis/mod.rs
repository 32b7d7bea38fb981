//! What can happen in a set of files, and what cannot: the questions that need more than names.
//!
//! [`holes`] says what of the set is not known because it could not be read or resolved: no warning may rest on that.

pub mod guards;
pub mod holes;

use crate::model::Model;

use super::diagnostic::Sink;
use holes::Holes;

/// Adds the warnings that rest on what can be active.
pub(super) fn check(_model: &Model, _holes: &Holes, _sink: &mut Sink) {}

#[cfg(test)]
mod tests;
