//! Where the framework is: a checkout, for what is new names it by its path.

use std::path::{Path, PathBuf};

use anyhow::anyhow;
use toml_edit::DocumentMut;

use crate::cli::exit::CommandError;
use crate::files;
use crate::qemu::firmware::checkout_around;

/// The crate that a robot depends on, below the checkout.
const CRATE: &str = "esm/Cargo.toml";

/// The package of the `esm` command, as cargo calls it.
const PACKAGE: &str = "host-tools ";

/// The checkout: the one that was named, the one around `from`, the one that this command was built
/// in, or the one that `cargo install` has installed it from; the first that is there.
///
/// # Errors
/// There is none: what to do.
pub fn find(named: Option<&Path>, from: &Path) -> Result<PathBuf, CommandError> {
    if let Some(named) = named {
        return is_framework(named).ok_or_else(|| {
            CommandError::Usage(anyhow!(
                "{} is no checkout of the framework: it has no {CRATE}",
                named.display()
            ))
        });
    }
    let command = std::env::current_exe().ok();
    let command = command.and_then(|command| command.canonicalize().ok());
    [
        checkout_around(from),
        command.as_deref().and_then(checkout_around),
        command.as_deref().and_then(installed_from),
    ]
    .into_iter()
    .flatten()
    .find_map(|folder| is_framework(&folder))
    .ok_or_else(|| {
        CommandError::Usage(anyhow!(
            "nobody knows where the framework is: name the folder of its checkout with --framework PATH"
        ))
    })
}

/// The folder by its whole name, if the framework is there.
fn is_framework(folder: &Path) -> Option<PathBuf> {
    let folder = folder.canonicalize().ok()?;
    folder.join(CRATE).is_file().then_some(folder)
}

/// The checkout that `cargo install --path` has installed a command from, as cargo wrote it down
/// beside its folder of commands.
fn installed_from(command: &Path) -> Option<PathBuf> {
    let list = command.parent()?.parent()?.join(".crates.toml");
    let text = files::read(&list, files::MAX_TEXT_BYTES).ok()?;
    source_of_package(&String::from_utf8(text).ok()?)
}

/// The checkout in a list of what cargo has installed:
/// `"host-tools 0.1.0 (path+file:///home/me/esm/host-tools)" = ["esm"]`.
fn source_of_package(list: &str) -> Option<PathBuf> {
    let list: DocumentMut = list.parse().ok()?;
    let installed = list.get("v1")?.as_table_like()?;
    let mut sources = installed.iter().filter_map(|(package, _)| {
        let (_, source) = package.strip_prefix(PACKAGE)?.split_once("(path+file://")?;
        source.strip_suffix(')')
    });
    // Cargo writes a blank as %20; the letters beyond ASCII likewise.
    let package = percent_decoded(sources.next()?)?;
    Path::new(&package).parent().map(Path::to_owned)
}

/// A path as it stands in a URL.
fn percent_decoded(path: &str) -> Option<String> {
    let mut bytes = Vec::new();
    let mut rest = path.bytes();
    while let Some(byte) = rest.next() {
        bytes.push(match byte {
            b'%' => {
                let digits = [rest.next()?, rest.next()?];
                u8::from_str_radix(std::str::from_utf8(&digits).ok()?, 16).ok()?
            }
            byte => byte,
        });
    }
    String::from_utf8(bytes).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_list_of_what_cargo_has_installed_names_the_checkout() {
        for (list, expected) in [
            (
                "[v1]\n\"ripgrep 14.1.0 (registry+https://github.com/rust-lang/crates.io-index)\" = [\"rg\"]\n\
                 \"host-tools 0.1.0 (path+file:///home/me/my%20esm/host-tools)\" = [\"esm\"]\n",
                Some("/home/me/my esm"),
            ),
            (
                "[v1]\n\"host-tools 0.1.0 (registry+https://github.com/rust-lang/crates.io-index)\" = [\"esm\"]\n",
                None,
            ),
            (
                "[v1]\n\"host-tools 0.1.0 (path+file:///a%2)\" = [\"esm\"]\n",
                None,
            ),
            ("no list", None),
        ] {
            let found = source_of_package(list);
            assert_eq!(found.as_deref(), expected.map(Path::new), "{list}");
        }
    }

    #[test]
    fn a_folder_that_is_no_checkout_is_refused_by_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let error = find(Some(folder.path()), folder.path()).unwrap_err();
        let said = error.message().unwrap().to_string();
        assert!(said.contains("is no checkout of the framework"), "{said}");
        let checkout = find(None, Path::new(".."))
            .ok()
            .or_else(|| find(None, &Path::new("..").canonicalize().unwrap()).ok());
        assert!(checkout.is_some_and(|it| it.join(CRATE).is_file()));
    }
}
