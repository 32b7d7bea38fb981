//! File names as editors write them: `file:` URIs.

use std::path::{Path, PathBuf};

/// The path that a `file:` URI names; none for other schemes, other hosts, and what is no UTF-8.
pub(super) fn to_path(uri: &str) -> Option<PathBuf> {
    let rest = uri.strip_prefix("file://")?;
    let slash = rest.find('/')?;
    let (host, path) = rest.split_at(slash);
    if !host.is_empty() && !host.eq_ignore_ascii_case("localhost") {
        return None;
    }
    let mut bytes = Vec::with_capacity(path.len());
    let mut rest = path.bytes();
    while let Some(byte) = rest.next() {
        match byte {
            b'%' => {
                let digits = [rest.next()?, rest.next()?];
                let digits = std::str::from_utf8(&digits).ok()?;
                bytes.push(u8::from_str_radix(digits, 16).ok()?);
            }
            b'?' | b'#' => break,
            _ => bytes.push(byte),
        }
    }
    let path = String::from_utf8(bytes).ok()?;
    // No file has such a name, and the system would stop reading there.
    (!path.contains('\0')).then(|| PathBuf::from(path))
}

/// The URI of an absolute path.
pub(super) fn of_path(path: &Path) -> String {
    let mut uri = "file://".to_owned();
    for byte in path.to_string_lossy().bytes() {
        if byte.is_ascii_alphanumeric() || b"/-._~".contains(&byte) {
            uri.push(char::from(byte));
        } else {
            uri.push_str(&format!("%{byte:02X}"));
        }
    }
    uri
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uris_and_their_paths() {
        for (uri, path) in [
            ("file:///a/b.esm", Some("/a/b.esm")),
            ("file://localhost/a", Some("/a")),
            ("file:///a%20b/%C3%A4.esm", Some("/a b/ä.esm")),
            ("file:///a#x", Some("/a")),
            ("file://other/a", None),
            ("file:///%ff", None),
            ("file:///%4", None),
            ("file:///a%00", None),
            ("untitled:Untitled-1", None),
            ("", None),
        ] {
            assert_eq!(to_path(uri), path.map(PathBuf::from), "{uri}");
        }
        for path in ["/a b/ä#?%.esm", "/x"] {
            assert_eq!(to_path(&of_path(Path::new(path))), Some(path.into()));
        }
    }
}
