//! Charts that are known from elsewhere, from turnstile to autopilot, and one small chart for each
//! sentence about what a machine means. What they must do was worked out by hand and stands in
//! their scenarios: `expect` lines, and comments that `esm sim` does not read.
//!
//! ```text
//! # takes 20 ms: r/A>r/B s/X>s/Y     exactly these transitions in the macro step at 20 ms, in this order
//! # enabled 20 ms: r/B               exactly these tasks are enabled after it
//! # active 20 ms: r/B s/Y            exactly these states are current after it
//! # micro 20 ms: 2                   it has so many micro steps
//! # fault 20 ms: macro-step-limit    it ends in this fault, and so does the run
//! ```
//! The interpreter and the reference are both held against it, and against each other line by line.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use esm_tests::scenario::{Scenario, time_us};
use esm_tests::{reference, subject};
use serde_json::Value;

/// One of the comments above.
struct Sentence {
    line: usize,
    word: String,
    at_us: u64,
    expected: Vec<String>,
}

/// The sentences in the comments of a scenario. Comments that begin with another word are for
/// people.
fn sentences(scenario: &str) -> Result<Vec<Sentence>, String> {
    let mut found = Vec::new();
    for (text, line) in scenario.lines().zip(1..) {
        let Some(comment) = text.strip_prefix("# ") else {
            continue;
        };
        let word = comment.split(' ').next().unwrap_or_default();
        if !["takes", "enabled", "active", "micro", "fault"].contains(&word) {
            continue;
        }
        let wrong = || format!("line {line} cannot be understood: {text}");
        let (head, rest) = comment.split_once(':').ok_or_else(wrong)?;
        let [_, count, unit] = head.split(' ').collect::<Vec<_>>()[..] else {
            return Err(wrong());
        };
        found.push(Sentence {
            line,
            word: word.to_owned(),
            at_us: time_us(count, unit).ok_or_else(wrong)?,
            expected: rest.split_whitespace().map(str::to_owned).collect(),
        });
    }
    Ok(found)
}

/// What a trace says about the macro step at a time, in the words of a sentence.
fn said(trace: &[Value], sentence: &Sentence) -> Vec<String> {
    let lines = |kind: &'static str| {
        trace
            .iter()
            .filter(move |line| line["kind"] == kind && line["t_us"] == sentence.at_us)
    };
    let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
    let list = |key: &str| {
        lines("step")
            .flat_map(|line| line[key].as_array().into_iter().flatten())
            .map(text)
            .collect()
    };
    match sentence.word.as_str() {
        "takes" => lines("transition")
            .map(|line| format!("{}>{}", text(&line["from"]), text(&line["to"])))
            .collect(),
        "enabled" => list("enabled"),
        "active" => list("active"),
        "micro" => lines("step")
            .map(|line| line["micro_steps"].to_string())
            .collect(),
        _ => lines("fault").map(|line| text(&line["code"])).collect(),
    }
}

/// How a run differs from what its scenario says; nothing where it does not. Gives the number of
/// expectations, too.
fn difference(chart: &Path) -> Result<(String, usize), String> {
    let text = fs::read_to_string(chart.with_extension("scenario"))
        .map_err(|error| format!("scenario: {error}"))?;
    let scenario: Scenario = text.parse()?;
    let built = subject::build_file(chart)?;
    let interpreter = subject::simulate(&built.blob, &scenario)?;
    let reference = reference::run(&built.model, &scenario);
    let sentences = sentences(&text)?;
    let mut told = String::new();
    if interpreter != reference {
        writeln!(
            told,
            "  interpreter and reference differ:\n{interpreter:#?}\n{reference:#?}"
        )
        .unwrap();
    }
    let trace: Vec<Value> = interpreter
        .trace
        .iter()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    for &entry in &interpreter.failed {
        let t_us = scenario.entries[entry].at_us;
        let active = trace
            .iter()
            .find(|line| line["kind"] == "step" && line["t_us"].as_u64() >= Some(t_us));
        let active = active
            .map(|line| line["active"].to_string())
            .unwrap_or_default();
        writeln!(told, "  failed: {}: {active}", scenario.entries[entry]).unwrap();
    }
    for sentence in &sentences {
        let said = said(&trace, sentence);
        if said != sentence.expected {
            let (line, word, expected) =
                (sentence.line, &sentence.word, sentence.expected.join(" "));
            writeln!(
                told,
                "  line {line}, {word}:\n    expected {expected}\n    found    {}",
                said.join(" ")
            )
            .unwrap();
        }
    }
    let has_fault = trace.iter().any(|line| line["kind"] == "fault");
    if has_fault != sentences.iter().any(|sentence| sentence.word == "fault") {
        writeln!(told, "  fault: {has_fault}").unwrap();
    }
    let expectations = text
        .lines()
        .filter(|line| line.contains(" expect "))
        .count()
        + sentences.len();
    Ok((told, expectations))
}

#[test]
fn charts_do_what_their_scenarios_say() {
    let folder = "cases/charts";
    let mut charts: Vec<PathBuf> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| {
            path.extension().is_some_and(|extension| extension == "esm")
                && !path.ends_with("robot.esm")
        })
        .collect();
    charts.sort();
    let mut told = String::new();
    let mut expectations = 0;
    for chart in &charts {
        let name = chart.file_stem().unwrap().display();
        match difference(chart) {
            Ok((difference, count)) => {
                expectations += count;
                if !difference.is_empty() {
                    writeln!(told, "{name}\n{difference}").unwrap();
                }
            }
            Err(cause) => writeln!(told, "{name}\n  {cause}").unwrap(),
        }
    }
    assert!(told.is_empty(), "{told}");
    assert!(
        charts.len() >= 40 && expectations >= 400,
        "{} charts, {expectations} expectations",
        charts.len()
    );
}
