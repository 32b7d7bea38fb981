//! The link between a robot and its host.
