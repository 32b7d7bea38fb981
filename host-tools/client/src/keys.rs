//! Keys that command robots: their files, and what they sign.
//!
//! A private key is a file of its owner alone, and stays on the host. It is never printed: what can
//! be shown of a key is its [`PublicKey`].

use std::env;
use std::fmt;
use std::fs::{self, OpenOptions};
use std::io::{self, Write};
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};

use ed25519_compact::{KeyPair, Seed};
use esm_link::access::{KEY_BYTES, NONCE_BYTES, SALT_BYTES, SIGNATURE_BYTES};
use esm_link::message::Identity;
use esm_link::proof::{Secret, is_same};
use thiserror::Error;
use zeroize::Zeroizing;

use crate::files;

/// What the line of a key's file begins with.
const MARK: &str = "esm-key-1 ";

/// Bytes that a private key is made from.
const PRIVATE_BYTES: usize = 32;

/// Permissions of a key's file, and those that it must not have.
const OWNER_ONLY: u32 = 0o600;
const OTHERS: u32 = 0o077;

/// No file of a key is longer: the mark, two letters a byte, a line's end and some words of its
/// owner's.
const MAX_FILE_BYTES: u64 = 4096;

/// Why there is no key.
#[derive(Debug, Error)]
pub enum KeyError {
    /// There is no such file.
    #[error(
        "there is no key at {}; `--key FILE` and ESM_KEY name another",
        path.display()
    )]
    Missing {
        /// Where one was looked for.
        path: PathBuf,
    },
    /// The file cannot be read or written.
    #[error("cannot use the key at {}: {cause}", path.display())]
    File {
        /// Which file.
        path: PathBuf,
        /// Why.
        cause: io::Error,
    },
    /// Others may read the file.
    #[error(
        "others may read the key at {0}; `chmod 600 {0}` makes it yours alone (if it was theirs to read for long, make another)",
        path.display()
    )]
    OpenToOthers {
        /// Which file.
        path: PathBuf,
    },
    /// The file holds something else.
    #[error("{} is no key that `esm key new` has made", path.display())]
    NotAKey {
        /// Which file.
        path: PathBuf,
    },
    /// There is one already.
    #[error(
        "there is a key at {} already, and robots may have it; `-o FILE` puts the new one elsewhere",
        path.display()
    )]
    Exists {
        /// Which file.
        path: PathBuf,
    },
    /// Nobody knows where keys are.
    #[error("neither XDG_CONFIG_HOME nor HOME says where keys are kept; name a file")]
    NoPlace,
    /// The system gives no random bytes.
    #[error("the system gives no random bytes: {0}")]
    NoRandomness(getrandom::Error),
}

/// The part of a key that everyone may know.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct PublicKey(pub [u8; KEY_BYTES]);

impl fmt::Display for PublicKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl fmt::Debug for PublicKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "PublicKey({self})")
    }
}

/// A key, its private part included.
pub struct SigningKey {
    pair: KeyPair,
}

// Not derived: the private part is nobody's business.
impl fmt::Debug for SigningKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "SigningKey({})", self.public())
    }
}

impl SigningKey {
    /// A key that nobody has.
    ///
    /// # Errors
    /// [`KeyError::NoRandomness`]
    pub fn generate() -> Result<(Self, Zeroizing<[u8; PRIVATE_BYTES]>), KeyError> {
        let mut private = Zeroizing::new([0; PRIVATE_BYTES]);
        getrandom::fill(private.as_mut()).map_err(KeyError::NoRandomness)?;
        Ok((Self::of(&private), private))
    }

    /// The key that is made from these bytes.
    pub fn of(private: &[u8; PRIVATE_BYTES]) -> Self {
        let mut seed = Seed::new(*private);
        let pair = KeyPair::from_seed(seed);
        seed.wipe_mut();
        SigningKey { pair }
    }

    /// Makes a key and puts it into a file that must not be there yet, and that only its owner may
    /// read.
    ///
    /// # Errors
    /// [`KeyError::Exists`], [`KeyError::File`], [`KeyError::NoRandomness`]
    pub fn create(path: &Path) -> Result<Self, KeyError> {
        let cannot = |cause: io::Error| match cause.kind() {
            io::ErrorKind::AlreadyExists => KeyError::Exists { path: path.into() },
            _ => KeyError::File {
                path: path.into(),
                cause,
            },
        };
        if let Some(folder) = path
            .parent()
            .filter(|folder| !folder.as_os_str().is_empty())
        {
            fs::DirBuilder::new()
                .recursive(true)
                .mode(0o700)
                .create(folder)
                .map_err(cannot)?;
        }
        let mut file = OpenOptions::new()
            .write(true)
            .create_new(true)
            .mode(OWNER_ONLY)
            .open(path)
            .map_err(cannot)?;
        let (key, private) = Self::generate()?;
        let mut text = Zeroizing::new(String::with_capacity(
            MARK.len() + 2 * PRIVATE_BYTES + "\n".len(),
        ));
        text.push_str(MARK);
        for byte in private.iter() {
            for digit in [byte >> 4, byte & 0xf] {
                text.extend(char::from_digit(digit.into(), 16));
            }
        }
        text.push('\n');
        file.write_all(text.as_bytes())
            .and_then(|()| file.sync_all())
            .map_err(cannot)?;
        Ok(key)
    }

    /// Reads a key from its file.
    ///
    /// # Errors
    /// [`KeyError::Missing`], [`KeyError::File`], [`KeyError::OpenToOthers`], [`KeyError::NotAKey`]
    pub fn read(path: &Path) -> Result<Self, KeyError> {
        let cannot = |cause: io::Error| match cause.kind() {
            io::ErrorKind::NotFound => KeyError::Missing { path: path.into() },
            _ => KeyError::File {
                path: path.into(),
                cause,
            },
        };
        let mut file = files::open(path).map_err(cannot)?;
        let about = file.metadata().map_err(cannot)?;
        let not_a_key = || KeyError::NotAKey { path: path.into() };
        if !about.is_file() {
            return Err(not_a_key());
        }
        if about.permissions().mode() & OTHERS != 0 {
            return Err(KeyError::OpenToOthers { path: path.into() });
        }
        if about.len() > MAX_FILE_BYTES {
            return Err(not_a_key());
        }
        // Of its whole length from the beginning, so that no copy stays behind where it grows.
        let mut bytes = Zeroizing::new(vec![0; about.len() as usize]);
        io::Read::read_exact(&mut file, &mut bytes).map_err(cannot)?;
        let private = private_of(&bytes).ok_or_else(not_a_key)?;
        Ok(Self::of(&private))
    }

    /// Its public part.
    pub fn public(&self) -> PublicKey {
        PublicKey(*self.pair.pk)
    }

    /// Signs a message that is given in pieces.
    pub fn sign(&self, message: &[&[u8]]) -> [u8; SIGNATURE_BYTES] {
        *self.pair.sk.sign(message.concat(), None)
    }

    /// What its owner shares with the robot of this salt.
    pub fn secret(&self, salt: &[u8; SALT_BYTES]) -> Secret {
        let mut private = self.pair.sk.seed();
        let secret = Secret::of_owner(private.as_ref(), salt);
        private.wipe_mut();
        secret
    }

    /// Whether a robot that answered this to the nonce `client` knows what it shares with the
    /// owner of this key.
    pub fn is_known_to(
        &self,
        Identity {
            key,
            salt,
            nonce,
            counter,
            proof,
        }: &Identity,
        client: &[u8; NONCE_BYTES],
    ) -> bool {
        let secret = self.secret(salt).keyed();
        is_same(
            proof,
            &secret.of_identity(client, key, salt, nonce, *counter),
        )
    }
}

/// The private part in the text of a key's file. Lines that do not begin with the mark are its
/// owner's words.
fn private_of(text: &[u8]) -> Option<Zeroizing<[u8; PRIVATE_BYTES]>> {
    let digits = text
        .split(|byte| *byte == b'\n')
        .find_map(|line| line.strip_prefix(MARK.as_bytes()))?
        .trim_ascii_end();
    let (pairs, []) = digits.as_chunks::<2>() else {
        return None;
    };
    if pairs.len() != PRIVATE_BYTES {
        return None;
    }
    let mut private = Zeroizing::new([0; PRIVATE_BYTES]);
    for (place, pair) in private.iter_mut().zip(pairs) {
        let [high, low] = pair.map(|digit| char::from(digit).to_digit(16));
        *place = (high? << 4 | low?) as u8;
    }
    Some(private)
}

/// Random bytes: a salt or a nonce.
///
/// # Errors
/// [`KeyError::NoRandomness`]
pub fn random() -> Result<[u8; NONCE_BYTES], KeyError> {
    const { assert!(NONCE_BYTES == SALT_BYTES) };
    let mut bytes = [0; NONCE_BYTES];
    getrandom::fill(&mut bytes).map_err(KeyError::NoRandomness)?;
    Ok(bytes)
}

/// The file that was named, or the one of those who name none.
///
/// # Errors
/// [`KeyError::NoPlace`]
pub fn path(named: Option<&Path>) -> Result<PathBuf, KeyError> {
    named.map_or_else(default_path, |path| Ok(path.to_owned()))
}

/// Where a key is unless its user says otherwise: `esm/key` among the configuration files.
///
/// # Errors
/// [`KeyError::NoPlace`]
pub fn default_path() -> Result<PathBuf, KeyError> {
    let set = |name| env::var_os(name).filter(|value| !value.is_empty());
    let configuration = match (set("XDG_CONFIG_HOME"), set("HOME")) {
        (Some(folder), _) => PathBuf::from(folder),
        (None, Some(home)) => PathBuf::from(home).join(".config"),
        (None, None) => return Err(KeyError::NoPlace),
    };
    Ok(configuration.join("esm").join("key"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_comes_back_from_its_file_which_is_its_owners_alone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("new folder").join("key");
        let key = SigningKey::create(&path).unwrap();
        assert_eq!(
            fs::metadata(&path).unwrap().permissions().mode() & 0o777,
            OWNER_ONLY
        );
        let read = SigningKey::read(&path).unwrap();
        assert_eq!(read.public(), key.public());
        assert_eq!(read.sign(&[b"a", b"bc"]), key.sign(&[b"ab", b"c"]));
        assert!(esm_link::keys::is_signed(
            &key.public().0,
            &read.sign(&[b"abc"]),
            &[b"ab", b"c"]
        ));
        assert!(matches!(
            SigningKey::create(&path),
            Err(KeyError::Exists { .. })
        ));
        assert_eq!(SigningKey::read(&path).unwrap().public(), key.public());
    }

    #[test]
    fn what_is_no_key_of_ones_own_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("key");
        assert!(matches!(
            SigningKey::read(&path),
            Err(KeyError::Missing { .. })
        ));
        SigningKey::create(&path).unwrap();
        for mode in [0o640, 0o604, 0o660] {
            fs::set_permissions(&path, fs::Permissions::from_mode(mode)).unwrap();
            let error = SigningKey::read(&path).unwrap_err();
            assert!(matches!(error, KeyError::OpenToOthers { .. }), "{mode:o}");
        }
        fs::set_permissions(&path, fs::Permissions::from_mode(0o400)).unwrap();
        assert!(SigningKey::read(&path).is_ok());
        fs::set_permissions(&path, fs::Permissions::from_mode(0o600)).unwrap();
        let digits = "0123456789abcdef".repeat(4);
        let cases = [
            (format!("esm-key-1 {digits}\n"), true),
            (format!("of robot 7\nesm-key-1 {digits}"), true),
            (format!("esm-key-1 {digits}0\n"), false),
            (format!("esm-key-1 {}\n", &digits[2..]), false),
            (format!("esm-key-1 {}\n", digits.replace('a', "g")), false),
            (format!("esm-key-2 {digits}\n"), false),
            ("x".repeat(5000), false),
            (String::new(), false),
        ];
        for (text, is_key) in cases {
            fs::write(&path, &text).unwrap();
            assert_eq!(SigningKey::read(&path).is_ok(), is_key, "{text}");
        }
    }

    #[test]
    fn the_private_part_is_not_printed() {
        let private = [0xab; PRIVATE_BYTES];
        let key = SigningKey::of(&private);
        let printed = format!("{key:?} {key:#?} {:?} {}", key.public(), key.public());
        assert!(!printed.contains("abab") && printed.contains(&key.public().to_string()));
    }
}
