//! Numbers that a person sets for a longer or another run of a test, as environment variables.

/// The whole number that a variable is set to; `default` where it is not set.
///
/// # Panics
/// If it is set to anything else.
pub fn number(name: &str, default: u64) -> u64 {
    match std::env::var(name) {
        Ok(text) => text
            .parse()
            .unwrap_or_else(|_| panic!("{name} is a whole number, not `{text}`")),
        Err(_) => default,
    }
}
