//! The files for editors against the language that they are about.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::collections::BTreeSet;

use esm_tests::command::root;
use host_tools::lang::RESERVED_WORDS;
use serde_json::Value;

fn read_json(name: &str) -> Value {
    let path = root().join("editors/vscode").join(name);
    let text = std::fs::read_to_string(&path).unwrap();
    serde_json::from_str(&text).unwrap_or_else(|error| panic!("{name}: {error}"))
}

/// The words of a pattern such as `\b(a|b)\b`.
fn words_of(pattern: &Value) -> Vec<String> {
    let text = pattern["match"].as_str().unwrap();
    let (_, behind) = text.split_once('(').unwrap();
    let (words, _) = behind.split_once(')').unwrap();
    words.split('|').map(str::to_owned).collect()
}

#[test]
fn the_colours_know_the_words_of_the_language_and_no_others() {
    let grammar = read_json("syntaxes/esm.tmLanguage.json");
    let patterns = grammar["repository"]["words"]["patterns"]
        .as_array()
        .unwrap();
    // Words that are not reserved are coloured where they are used as words alone.
    let reserved = patterns
        .iter()
        .filter(|it| it["name"] != "keyword.other.esm");
    let coloured: Vec<String> = reserved.flat_map(words_of).collect();
    let known: BTreeSet<&str> = RESERVED_WORDS.into_iter().collect();
    let found: BTreeSet<&str> = coloured.iter().map(String::as_str).collect();
    assert_eq!(found, known);
    assert_eq!(coloured.len(), known.len(), "a word has two colours");
    let others = patterns
        .iter()
        .filter(|it| it["name"] == "keyword.other.esm");
    for word in others.flat_map(words_of) {
        assert!(!known.contains(word.as_str()), "{word} is reserved");
    }
}

#[test]
fn the_parts_of_the_extension_fit_together() {
    let package = read_json("package.json");
    let contributes = &package["contributes"];
    let language = &contributes["languages"][0];
    let grammar = &contributes["grammars"][0];
    assert_eq!(language["extensions"][0], ".esm");
    assert_eq!(grammar["language"], language["id"]);
    let scope = read_json(grammar["path"].as_str().unwrap())["scopeName"].clone();
    assert_eq!(grammar["scopeName"], scope);
    let comments = read_json(language["configuration"].as_str().unwrap())["comments"].clone();
    assert_eq!(comments["lineComment"], "//");
    assert_eq!(package["version"], env!("CARGO_PKG_VERSION"));
    let main = package["main"].as_str().unwrap();
    assert!(root().join("editors/vscode").join(main).is_file());
}
