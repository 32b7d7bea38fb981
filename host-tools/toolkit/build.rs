//! Collects what each `boards/*/board.toml` says of its board, so that the command knows the boards
//! also where there is no checkout. Takes the widths of letters from the font, so that what lays
//! words out and draws none (the studio's engine) does without the font itself.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::PathBuf;
use std::{env, fs};

use board_settings::BoardFiles;
use ttf_parser::{Face, GlyphId};

/// Keys of `[capacities]` that a mission is compared with, and the fields of `Capacities` that they
/// become.
const CAPACITIES: [(&str, &str); 6] = [
    ("blob_bytes", "blob_bytes"),
    ("arena_words", "arena_words"),
    ("slots", "slots"),
    ("tasks", "task_instances"),
    ("nets", "nets"),
    ("exclusive_groups", "exclusive_groups"),
];

/// Keys of `[flashing]`, which are the fields of `Flashing`, too.
const FLASHING: [&str; 5] = [
    "uf2_family",
    "boot_board_id",
    "boot_model",
    "boot_button",
    "probe_rs_chip",
];

/// Values by section and key, as they are written.
type Settings = BTreeMap<(String, String), String>;

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    let mut list = String::from("[\n");
    let mut defaults = Vec::new();
    for files in board_settings::BOARDS {
        let settings = settings(files.settings);
        if settings
            .get(&key("", "default"))
            .is_some_and(|it| it == "true")
        {
            defaults.push(settings[&key("", "name")].clone());
        }
        list += &board(files, &settings);
    }
    list += "]\n";
    let [default] = &defaults[..] else {
        panic!("one board has `default = true`, and not these: {defaults:?}");
    };
    fs::write(folder("OUT_DIR").join("default_board.rs"), default)
        .expect("OUT_DIR can be written to");
    fs::write(folder("OUT_DIR").join("boards.rs"), list).expect("OUT_DIR can be written to");
    let widths = format!(
        "[&{}, &{}]",
        widths(ttf_noto_sans::REGULAR),
        widths(ttf_noto_sans::BOLD)
    );
    fs::write(folder("OUT_DIR").join("widths.rs"), widths).expect("OUT_DIR can be written to");
}

/// The widths of a font's letters as a list: each letter from which on letters have another width,
/// and that width.
fn widths(font: &[u8]) -> String {
    let face = Face::parse(font, 0).expect("the font can be read");
    let mut list = String::from("[");
    let mut last = None;
    for letter in '\0'..=char::MAX {
        // A letter that the font lacks is its box for such.
        let glyph = face.glyph_index(letter).unwrap_or(GlyphId(0));
        let width = face.glyph_hor_advance(glyph).unwrap_or(0);
        if last != Some(width) {
            // Writing to a string cannot fail.
            let _ = write!(list, "({}, {width}), ", u32::from(letter));
            last = Some(width);
        }
    }
    list + "]"
}

fn folder(variable: &str) -> PathBuf {
    env::var_os(variable)
        .expect("cargo sets its variables")
        .into()
}

/// A board as an item of the list.
fn board(files: &BoardFiles, settings: &Settings) -> String {
    let value = |section: &str, key: &str| {
        settings
            .get(&self::key(section, key))
            .unwrap_or_else(|| panic!("the board {} has no `{key}` in [{section}]", files.name))
    };
    let name = value("", "name");
    assert_eq!(
        *name,
        format!("{:?}", files.name),
        "a board has the name of its folder"
    );
    let mut item = format!(
        "Board {{ name: {name}, description: {}, capacities: Capacities {{",
        value("", "description")
    );
    for (key, field) in CAPACITIES {
        // Writing to a string cannot fail.
        let _ = write!(item, " {field}: {},", value("capacities", key));
    }
    // Values are written as in Rust.
    let _ = write!(
        item,
        " }}, links: {}, firmware: Some(Firmware {{ target: {}, bin: {}, runner: {}, flash: Flash {{ origin: {}, bytes: {}, erase_bytes: {} }}, stack_bytes: {} }}), flashing: ",
        match settings.get(&key("links", "feature")) {
            Some(feature) => format!("Some({feature})"),
            None => "None".to_owned(),
        },
        value("", "target"),
        value("", "firmware"),
        value("runner", "command"),
        value("flash", "origin"),
        value("flash", "bytes"),
        value("flash", "erase_bytes"),
        match settings.get(&key("limits", "stack_bytes")) {
            Some(bytes) => format!("Some({bytes})"),
            None => "None".to_owned(),
        }
    );
    item += &match settings.contains_key(&key("flashing", "uf2_family")) {
        true => format!("Some({}), interpreter: ", flashing(value)),
        // An emulator's.
        false => "None, interpreter: ".to_owned(),
    };
    item += &match files.costs {
        Some(text) => format!(
            "Some(InterpreterSpeed {{ costs: {text:?}, instruction_ns: {} }})",
            value("clock", "instruction_ns")
        ),
        // Not measured.
        None => "None".to_owned(),
    };
    item + " },\n"
}

/// What brings a firmware onto a board.
fn flashing<'s>(value: impl Fn(&str, &str) -> &'s String) -> String {
    let fields = FLASHING.map(|key| format!("{key}: {}", value("flashing", key)));
    format!("Flashing {{ {} }}", fields.join(", "))
}

fn key(section: &str, key: &str) -> (String, String) {
    (section.to_owned(), key.to_owned())
}

/// Reads the part of TOML that `board.toml` is written in: sections, and `key = value` on one line.
fn settings(text: &str) -> Settings {
    let mut settings = Settings::new();
    let mut section = String::new();
    for line in text.lines().map(str::trim) {
        if let Some(name) = line
            .strip_prefix('[')
            .and_then(|rest| rest.strip_suffix(']'))
        {
            section = name.to_owned();
        } else if let (false, Some((key, value))) = (line.starts_with('#'), line.split_once('=')) {
            let place = (section.clone(), key.trim().to_owned());
            settings.insert(place, value.trim().to_owned());
        }
    }
    settings
}
