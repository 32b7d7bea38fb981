//! The compiler and the interpreter against the reference, on random machines: the same trace, line
//! by line, and the same expectations failed.
//!
//! `ESM_MACHINES` sets how many machines are made (300 if unset), `ESM_SEED` the seed of the first.
//! A failure prints both the seed and the smallest machine found that still fails.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use esm_tests::occasions::Occasions;
use esm_tests::reference::{self, Outcome};
use esm_tests::scenario::Scenario;
use esm_tests::shrink::shrink;
use esm_tests::{environment, random_machine, subject};

const DEFAULT_MACHINES: u64 = 300;
const SCENARIOS_A_MACHINE: u64 = 2;
/// Runs that may be made to shrink a failure.
const SHRINK_BUDGET: usize = 1_500;

/// Where the two differ, for a person; nothing where they agree.
fn difference(text: &str, scenario: &Scenario) -> Option<String> {
    let built = match subject::build(text) {
        Ok(built) => built,
        Err(cause) => return Some(cause),
    };
    let expected = reference::run(&built.model, scenario);
    match subject::simulate(&built.blob, scenario) {
        Ok(found) => first_difference(&expected, &found),
        Err(cause) => Some(cause),
    }
}

fn first_difference(expected: &Outcome, found: &Outcome) -> Option<String> {
    let end = "(the trace has ended)".to_owned();
    let lines = expected.trace.len().max(found.trace.len());
    for line in 0..lines {
        let expected = expected.trace.get(line).unwrap_or(&end);
        let found = found.trace.get(line).unwrap_or(&end);
        if expected != found {
            return Some(format!(
                "line {}:\n  reference: {expected}\n  esm:       {found}",
                line + 1
            ));
        }
    }
    (expected.failed != found.failed).then(|| {
        format!(
            "entries of which the expectation failed:\n  reference: {:?}\n  esm:       {:?}",
            expected.failed, found.failed
        )
    })
}

/// Makes the failing case small. A text that the front end refuses is no smaller case, unless that
/// is the failure itself.
fn smallest(text: &str, scenario: &Scenario) -> String {
    let refused = subject::build(text).is_err();
    let still_fails = |text: &str, scenario: &Scenario| {
        subject::build(text).is_err() == refused
            && std::panic::catch_unwind(|| difference(text, scenario)).is_ok_and(|it| it.is_some())
    };
    let mut scenario = scenario.clone();
    let mut index = 0;
    while index < scenario.entries.len() && !refused {
        let entry = scenario.entries.remove(index);
        if !still_fails(text, &scenario) {
            scenario.entries.insert(index, entry);
            index += 1;
        }
    }
    let text = shrink(text, SHRINK_BUDGET, |text| still_fails(text, &scenario));
    let cause = difference(&text, &scenario).unwrap_or_default();
    format!("--- machine\n{text}\n--- scenario\n{scenario}--- {cause}")
}

#[test]
fn random_machines_run_as_the_reference_says() {
    let first = environment::number("ESM_SEED", 1);
    let machines = environment::number("ESM_MACHINES", DEFAULT_MACHINES);
    let mut sample = Sample::default();
    let mut occasions = Occasions::default();
    for seed in first..first + machines {
        let text = random_machine::machine(seed);
        let built = subject::build(&text).unwrap_or_else(|cause| {
            panic!(
                "the machine of seed {seed} is without errors by construction, but {cause}\n{}",
                smallest(&text, &Scenario::default())
            )
        });
        for number in 0..SCENARIOS_A_MACHINE {
            let scenario =
                random_machine::scenario(seed * SCENARIOS_A_MACHINE + number, &built.model);
            let (expected, taken) = reference::run_noting(&built.model, &scenario);
            let found = subject::simulate(&built.blob, &scenario);
            let difference = match &found {
                Ok(found) => first_difference(&expected, found),
                Err(cause) => Some(cause.clone()),
            };
            if let Some(difference) = difference {
                panic!(
                    "seed {seed}, scenario {number} of it: {difference}\nThe smallest case found:\n{}",
                    smallest(&text, &scenario)
                );
            }
            sample.add(&expected);
            occasions.add(&built.model, &taken);
        }
    }
    println!("{machines} machines from seed {first}: {sample:?}\n{occasions:?}");
    if machines >= DEFAULT_MACHINES {
        sample.assert_has_all();
        occasions.assert_all();
    }
}

/// How often what matters happened, so that agreement is never agreement about nothing.
#[derive(Debug, Default)]
struct Sample {
    transitions: usize,
    on_events: usize,
    nested: usize,
    sent: usize,
    set: usize,
    cleared: usize,
    finals: usize,
    queue_overflows: usize,
    macro_step_limits: usize,
    long_macro_steps: usize,
    enabled_outside_active: usize,
    failed_expectations: usize,
}

impl Sample {
    fn add(&mut self, outcome: &Outcome) {
        self.failed_expectations += outcome.failed.len();
        for line in &outcome.trace {
            let line: serde_json::Value = serde_json::from_str(line).unwrap();
            let filled =
                |key: &str| usize::from(line[key].as_array().is_some_and(|it| !it.is_empty()));
            match line["kind"].as_str().unwrap() {
                "transition" => {
                    self.transitions += 1;
                    self.on_events += usize::from(line["event"] != "pulse");
                    self.nested += usize::from(line["to"].as_str().unwrap().split('/').count() > 2);
                    self.finals += usize::from(line["to"].as_str().unwrap().ends_with("/final"));
                    self.sent += filled("sent");
                    self.set += filled("set");
                    self.cleared += filled("cleared");
                }
                "step" => {
                    let active = line["active"].as_array().unwrap();
                    let enabled = line["enabled"].as_array().unwrap();
                    self.long_macro_steps += usize::from(line["micro_steps"].as_u64().unwrap() > 5);
                    self.enabled_outside_active +=
                        usize::from(enabled.iter().any(|path| !active.contains(path)));
                }
                _ if line["code"] == "event-queue-overflow" => self.queue_overflows += 1,
                _ => self.macro_step_limits += 1,
            }
        }
    }

    fn assert_has_all(&self) {
        let least = [
            ("transitions", self.transitions, 10_000),
            ("transitions on events", self.on_events, 1_000),
            ("transitions inside superstates", self.nested, 1_000),
            ("transitions that send", self.sent, 1_000),
            ("transitions that set a flag", self.set, 500),
            ("transitions that clear a flag", self.cleared, 500),
            ("transitions to final", self.finals, 100),
            ("queue overflows", self.queue_overflows, 10),
            ("macro steps without end", self.macro_step_limits, 10),
            ("macro steps of many micro steps", self.long_macro_steps, 20),
            (
                "runs that outlive their state",
                self.enabled_outside_active,
                50,
            ),
            ("failed expectations", self.failed_expectations, 50),
        ];
        for (what, found, least) in least {
            assert!(
                found >= least,
                "the sample has {found} {what}, too few to say much: {self:?}"
            );
        }
    }
}
