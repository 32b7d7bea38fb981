//! Files that were looked at once, for tests of what is drawn.

use std::fs;
use std::path::Path;

/// Compares with a file that was looked at once. `ESM_BLESS=1` writes it anew, to be looked at
/// again.
pub fn assert_golden(path: impl AsRef<Path>, found: &[u8]) {
    let path = path.as_ref();
    if std::env::var_os("ESM_BLESS").is_some() {
        fs::write(path, found).unwrap();
    }
    let expected = fs::read(path).unwrap();
    assert!(
        expected == found,
        "{} differs: look at it with ESM_BLESS=1",
        path.display()
    );
}
