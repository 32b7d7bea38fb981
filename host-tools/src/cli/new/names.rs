//! Names of what is new: words that Rust, cargo and the firmware take.

use anyhow::{anyhow, bail};

/// A name has at most so many letters: a robot tells its name and version in 40 bytes.
const MOST_LETTERS: usize = 24;

/// Keywords of Rust, strict and reserved, and those that some edition has. Source: The Rust
/// Reference, "Keywords".
const KEYWORDS: [&str; 53] = [
    "abstract", "as", "async", "await", "become", "box", "break", "const", "continue", "crate",
    "do", "dyn", "else", "enum", "extern", "false", "final", "fn", "for", "gen", "if", "impl",
    "in", "let", "loop", "macro", "match", "mod", "move", "mut", "override", "priv", "pub", "ref",
    "return", "self", "static", "struct", "super", "trait", "true", "try", "type", "typeof",
    "union", "unsafe", "unsized", "use", "virtual", "where", "while", "yield", "raw",
];

/// Names that crates of the robot's, or files of it, have already.
const TAKEN: [&str; 17] = [
    "alloc",
    "bin",
    "build",
    "core",
    "deps",
    "embedded_hal",
    "esm",
    "examples",
    "firmware",
    "host_tools",
    "lib",
    "main",
    "proc_macro",
    "robot_file",
    "rt_firmware",
    "std",
    "test",
];

/// Types that a robot's registry has in scope, or that every module of Rust has.
const TYPES: [&str; 25] = [
    "BatteryMonitor",
    "Behaviours",
    "Box",
    "Cruise",
    "Err",
    "Headlight",
    "Io",
    "Lamp",
    "Measures",
    "None",
    "Odometry",
    "Ok",
    "Option",
    "PartTypes",
    "PhantomData",
    "Ranges",
    "Result",
    "RobotParts",
    "Some",
    "SonarRing",
    "Step",
    "Task",
    "TaskPool",
    "Turn",
    "WheelSpeed",
];

/// The name of something new, and of its type.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Name {
    /// As a file, a module and a crate: `come_near`.
    pub snake: String,
    /// As a type and a machine: `ComeNear`.
    pub camel: String,
}

impl Name {
    /// Takes a name that somebody gives.
    ///
    /// # Errors
    /// It is no name, or one that is taken: what to do.
    pub fn new(given: &str) -> anyhow::Result<Self> {
        let is_word = given.starts_with(|c: char| c.is_ascii_lowercase())
            && given
                .chars()
                .all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_')
            && !given.ends_with('_')
            && !given.contains("__");
        if !is_word {
            bail!(
                "`{}` is no name: it is of small letters, digits and single `_`, and begins with a letter{}",
                given.escape_debug(),
                meant(given)
            );
        }
        if given.len() > MOST_LETTERS {
            bail!(
                "`{given}` has {} letters: a name has {MOST_LETTERS} at most",
                given.len()
            );
        }
        if KEYWORDS.contains(&given) {
            bail!("`{given}` is a keyword of Rust: take another name");
        }
        if TAKEN.contains(&given) {
            bail!(
                "`{given}` is what something of the robot's is called already: take another name"
            );
        }
        let camel = camel(given);
        if TYPES.contains(&camel.as_str()) {
            return Err(anyhow!(
                "the type of `{given}` would be `{camel}`, which there is already: take another name"
            ));
        }
        Ok(Self {
            snake: given.to_owned(),
            camel,
        })
    }
}

/// `come_near` as a type: `ComeNear`.
fn camel(snake: &str) -> String {
    let words = snake.split('_').map(|word| {
        let mut letters = word.chars();
        let first = letters.next().map(|first| first.to_ascii_uppercase());
        first.into_iter().chain(letters).collect::<String>()
    });
    words.collect()
}

/// `; did you mean …?`, where a name is near.
fn meant(given: &str) -> String {
    let like = likely(given);
    if like == given || !given.is_ascii() {
        return String::new();
    }
    match Name::new(&like) {
        Ok(name) => format!("; did you mean `{}`?", name.snake),
        Err(_) => String::new(),
    }
}

/// What may have been meant: `ComeNear`, `come-near` and `come near` are `come_near`.
fn likely(given: &str) -> String {
    let mut name = String::new();
    for letter in given.chars() {
        let is_start = letter.is_ascii_uppercase() || !letter.is_ascii_alphanumeric();
        if is_start && !name.is_empty() && !name.ends_with('_') {
            name.push('_');
        }
        if letter.is_ascii_alphanumeric() {
            name.push(letter.to_ascii_lowercase());
        }
    }
    name.trim_end_matches('_').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_a_module_and_a_type() {
        for (given, expected) in [
            ("my_robot", "MyRobot"),
            ("r2", "R2"),
            ("a", "A"),
            ("come_near_2", "ComeNear2"),
        ] {
            let name = Name::new(given).unwrap();
            assert_eq!(
                (name.snake.as_str(), name.camel.as_str()),
                (given, expected)
            );
        }
    }

    #[test]
    fn what_is_no_name_is_refused_with_what_to_do() {
        for (given, expected) in [
            ("", "`` is no name"),
            ("MyRobot", "did you mean `my_robot`?"),
            ("my-robot", "did you mean `my_robot`?"),
            ("my robot", "did you mean `my_robot`?"),
            ("2fast", "begins with a letter"),
            ("röbot", "`röbot` is no name"),
            ("../up", "did you mean `up`?"),
            ("a\u{1b}[2J", "`a\\u{1b}[2J` is no name"),
            ("loop", "`loop` is a keyword of Rust"),
            (
                "esm",
                "`esm` is what something of the robot's is called already",
            ),
            ("turn", "the type of `turn` would be `Turn`"),
            ("a234567890123456789012345", "has 25 letters"),
        ] {
            let said = Name::new(given).unwrap_err().to_string();
            assert!(said.contains(expected), "{given}: {said}");
        }
    }
}
