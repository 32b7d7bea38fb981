//! One token of a right file is left out or written twice: that costs one message, or two, and
//! never a page of them.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::fs;
use std::ops::Range;

use host_tools::lang::{self, Severity};

/// The tokens of a right text, by the shortest route.
fn tokens(text: &str) -> Vec<Range<usize>> {
    let mut tokens = Vec::new();
    let mut at = 0;
    while let Some(first) = text[at..].chars().next() {
        let rest = &text[at..];
        let length_of =
            |is_part: fn(char) -> bool| rest.find(|letter| !is_part(letter)).unwrap_or(rest.len());
        let length = match first {
            _ if first.is_whitespace() => {
                at += first.len_utf8();
                continue;
            }
            '/' if rest.starts_with("//") => {
                at += rest.find('\n').unwrap_or(rest.len());
                continue;
            }
            '/' if rest.starts_with("/*") => {
                at += rest.find("*/").unwrap() + 2;
                continue;
            }
            '"' => rest[1..].find('"').unwrap() + 2,
            '-' if rest.starts_with("->") => 2,
            '0'..='9' => length_of(|letter| letter.is_ascii_digit() || letter == '.'),
            _ if first.is_alphabetic() || first == '_' => {
                length_of(|letter| letter.is_alphanumeric() || letter == '_')
            }
            _ => first.len_utf8(),
        };
        tokens.push(at..at + length);
        at += length;
    }
    tokens
}

/// How many errors the front end reports in a text that uses the tasks of the robots.
fn errors(text: &str, others: &[(&str, String)]) -> Vec<String> {
    let mut files = vec![("changed.esm", text)];
    files.extend(others.iter().map(|(name, text)| (*name, text.as_str())));
    let checked = lang::load_texts(&files);
    let errors = checked
        .diagnostics
        .iter()
        .filter(|found| found.severity() == Severity::Error);
    let told = |found: &lang::Diagnostic| {
        let place = checked.position(found.span);
        format!(
            "{}:{} {} {}",
            place.line,
            place.col,
            found.code,
            found.text()
        )
    };
    errors.map(told).collect()
}

/// Changes each token of some right files in turn, and demands that no change costs more than
/// `most` errors.
fn change_each_token(most: usize, change: impl Fn(&str, Range<usize>) -> String) {
    let read = |name: &str| fs::read_to_string(name).unwrap();
    let others = [
        ("rover.esm", read("../missions/rover.esm")),
        ("robot.esm", read("cases/charts/robot.esm")),
    ];
    for name in [
        "../missions/patrol.esm",
        "cases/charts/hierarchy.esm",
        "cases/charts/actions_in_order.esm",
    ] {
        let text = read(name);
        assert_eq!(errors(&text, &others), Vec::<String>::new(), "{name}");
        for token in tokens(&text) {
            let line = text[..token.start].matches('\n').count() + 1;
            let found = errors(&change(&text, token.clone()), &others);
            assert!(
                found.len() <= most,
                "{name}:{line}: `{}`: {found:#?}",
                &text[token]
            );
        }
    }
}

#[test]
fn a_token_that_is_missing_costs_one_error() {
    change_each_token(1, |text, token| {
        format!("{}{}", &text[..token.start], &text[token.end..])
    });
}

#[test]
fn a_token_that_stands_twice_costs_two_errors_at_most() {
    change_each_token(2, |text, token| {
        format!("{} {}", &text[..token.end], &text[token.start..])
    });
}
