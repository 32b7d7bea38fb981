//! A mission's hash, as people see it.

/// Eight hexadecimal digits.
pub fn hash_text(hash: u32) -> String {
    format!("{hash:08x}")
}
