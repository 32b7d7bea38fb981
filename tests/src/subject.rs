//! What is tested: the way from text to a blob to a trace, as `esm build` and `esm sim` go it.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use esm_core::Verified;
use host_tools::lang::Checked;
use host_tools::model::Model;
use host_tools::time::work_limit;
use host_tools::trace::directory::Directory;
use host_tools::{compile, lang, scenario, sim};

use crate::reference::Outcome;
use crate::scenario::Scenario;

/// How long start times of slots are searched for; the slots of the tests are laid out at once.
const LAY_OUT_LIMIT: Duration = Duration::from_secs(10);

/// A text that went through the front end and the compiler.
pub struct Built {
    /// What the front end made of it.
    pub model: Model,
    /// What the compiler made of that.
    pub blob: Vec<u8>,
}

/// Checks, lays out and compiles a text.
///
/// # Errors
/// Says what stood in the way, for a person.
pub fn build(text: &str) -> Result<Built, String> {
    compiled(lang::load_text("machine.esm", text))
}

/// [`build`] for a set of files, by path and content, of which the first is the mission.
///
/// # Errors
/// Says what stood in the way, for a person.
pub fn build_files(files: &[(&str, &[u8])]) -> Result<Built, String> {
    compiled(lang::load_files(files))
}

/// Checks, lays out and compiles a file with all that it uses.
///
/// # Errors
/// Says what stood in the way, for a person.
pub fn build_file(path: &Path) -> Result<Built, String> {
    compiled(lang::load(path).map_err(|error| error.to_string())?)
}

fn compiled(mut checked: Checked) -> Result<Built, String> {
    checked.require_machine();
    let schedule = checked.lay_out(work_limit(LAY_OUT_LIMIT));
    if checked.has_errors() {
        return Err(format!(
            "the front end refuses it:\n{}",
            checked.render(false)
        ));
    }
    let model = checked.model.ok_or("no errors and yet no model")?;
    let schedule = schedule.ok_or("no errors and yet no schedule")?;
    let blob = compile::compile(&model, &schedule)
        .map_err(|error| format!("the compiler refuses it: {error}"))?;
    Ok(Built { model, blob })
}

/// Verifies a blob that was just compiled.
///
/// # Errors
/// Says what the verifier refused, for a person.
pub fn verified(blob: &[u8]) -> Result<Verified<Vec<u8>>, String> {
    esm_core::verify(blob.to_vec())
        .map_err(|(_, refusal)| format!("the verifier refuses what the compiler made: {refusal:?}"))
}

/// Runs a blob through a scenario, which goes through its text form on the way.
///
/// # Errors
/// Says what stood in the way, for a person.
pub fn simulate(blob: &[u8], scenario: &Scenario) -> Result<Outcome, String> {
    let verified = verified(blob)?;
    let directory = Directory::of(&verified.tables()).map_err(|error| error.to_string())?;
    let directory = Arc::new(directory);
    let text = scenario.to_string();
    let ports = scenario::ports::Ports::of(&verified.tables(), &directory);
    let bound = scenario::parse(&text)
        .and_then(|parsed| scenario::bind::bind(&parsed, &directory, &ports))
        .map_err(|mistakes| format!("the scenario has mistakes: {mistakes:?}\n{text}"))?;
    let mut trace = Vec::new();
    let outcome =
        sim::run(verified, &directory, &bound, &mut trace).map_err(|error| error.to_string())?;
    let trace = String::from_utf8(trace).map_err(|error| error.to_string())?;
    let lines_before_entries = 1 + usize::from(scenario.period_us.is_some());
    let mut failed: Vec<usize> = outcome
        .failures
        .iter()
        .map(|failure| failure.name.place.line - lines_before_entries)
        .collect();
    failed.sort_unstable();
    Ok(Outcome {
        trace: trace.lines().map(str::to_owned).collect(),
        failed,
    })
}
