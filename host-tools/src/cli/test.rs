//! `esm test`: all scenarios of a folder.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, anyhow};
use clap::Args;
use esm_core::Verified;
use serde::Serialize;

use super::console::Console;
use super::exit::CommandError;
use super::file;
use super::mission::{self, Audience};
use crate::clean::counted;
use crate::compile::NameTable;
use crate::files;
use crate::lang::Severity;
use crate::scenario::bind;
use crate::scenario::ports::Ports;
use crate::scenario::suite::{self, Case};
use crate::sim::{self, Outcome, milliseconds};
use crate::trace::directory::Directory;

/// Runs every scenario in a folder against its mission
///
/// A scenario belongs to the mission that its name begins with: patrol.scenario and
/// patrol.halt.scenario to patrol.esm beside them. One without such a mission belongs to the
/// mission that its folder is named after: patrol/halt.scenario to patrol.esm beside the folder.
/// Folders inside are looked through too. The exit status is 1 if a scenario fails, has mistakes or
/// has no mission, or if a mission does not compile.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm test missions
  esm test missions halt          # those with `halt` in their path
  esm test missions --json | jq -c 'select(.ok == false)'

Behind a failed expectation stands what happened up to it, with its line marked by `>`.

With --json one object a line: scenario, mission, ok, macro_steps, simulated_us, met, and failures, a list of line, col, message, before, timeline. The last line has passed and failed.")]
pub struct TestArgs {
    /// Where the scenarios are
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,

    /// Only those whose path below DIR has this text in it
    #[arg(value_name = "FILTER")]
    pub filter: Option<String>,

    /// One JSON object a scenario, for programs
    #[arg(long)]
    pub json: bool,
}

/// What came of a scenario.
#[derive(Debug, Default, Serialize)]
struct Verdict {
    /// Path of the scenario.
    scenario: String,
    /// Path of the mission.
    mission: Option<String>,
    /// Whether all expectations were met, without a fault.
    ok: bool,
    /// Macro steps that were run.
    macro_steps: u64,
    /// Robot time of the last of them.
    simulated_us: u64,
    /// Expectations that were met.
    met: usize,
    /// What went wrong.
    failures: Vec<Fail>,
}

/// Something that went wrong.
#[derive(Debug, Serialize)]
struct Fail {
    /// Line of the scenario; none where it is not about one.
    line: Option<usize>,
    /// Column.
    col: Option<usize>,
    /// What a person reads.
    message: String,
    /// The last transitions before it.
    before: Vec<String>,
    /// What happened in the macro steps up to it, a line each, with the failed line marked.
    timeline: Vec<String>,
}

impl Fail {
    fn of_the_whole(message: String) -> Self {
        Fail {
            line: None,
            col: None,
            message,
            before: Vec::new(),
            timeline: Vec::new(),
        }
    }
}

/// The last line of `--json`.
#[derive(Serialize)]
struct Total {
    passed: usize,
    failed: usize,
}

/// A mission that several scenarios share.
type Compiled = Result<(Verified<Vec<u8>>, Arc<Directory>), String>;

/// Runs the command.
///
/// # Errors
/// If there are no scenarios, or one is not ok.
pub fn execute(args: &TestArgs, console: &mut Console) -> Result<(), CommandError> {
    let cases = cases(args)?;
    let audience = if args.json {
        Audience::Program
    } else {
        Audience::Person
    };
    let mut missions: BTreeMap<PathBuf, Compiled> = BTreeMap::new();
    let mut total = Total {
        passed: 0,
        failed: 0,
    };
    for case in &cases {
        let verdict = verdict(case, &mut missions, audience);
        if verdict.ok {
            total.passed += 1;
        } else {
            total.failed += 1;
        }
        if args.json {
            console.json_line(&verdict)?;
        } else {
            tell(&verdict, console)?;
        }
    }
    if args.json {
        console.json_line(&total)?;
    } else {
        let (passed, failed) = (total.passed, total.failed);
        let scenarios = counted(cases.len() as u64, "scenario");
        let count = counted(missions.len() as u64, "mission");
        writeln!(
            console.out(),
            "\n{scenarios} of {count}: {passed} ok, {failed} failed"
        )?;
    }
    if total.failed == 0 {
        Ok(())
    } else {
        Err(CommandError::Told)
    }
}

/// The scenarios that were asked for; at least one.
fn cases(args: &TestArgs) -> Result<Vec<Case>, CommandError> {
    let folder = args.folder.display();
    if !args.folder.exists() {
        return Err(CommandError::Input(anyhow!(
            "there is no {folder}: name a folder with scenarios in it"
        )));
    }
    let is_scenario = |ending: &std::ffi::OsStr| ending == suite::SCENARIO;
    if !args.folder.is_dir() && !args.folder.extension().is_some_and(is_scenario) {
        return Err(CommandError::Input(anyhow!(
            "{folder} is neither a folder nor a scenario: name a folder with scenarios in it, or one file that ends in `.scenario`"
        )));
    }
    if !args.folder.is_dir() {
        files::require(&args.folder)
            .with_context(|| format!("cannot read the scenario {folder}"))
            .map_err(CommandError::Input)?;
    }
    let mut cases = suite::cases(&args.folder, suite::SCENARIO)
        .map_err(|error| CommandError::Input(error.into()))?;
    if cases.is_empty() {
        return Err(CommandError::Input(anyhow!(
            "{folder} has no scenarios: a file `NAME.scenario` or `NAME.anything.scenario` beside a mission `NAME.esm`, or one in a folder `NAME` beside it"
        )));
    }
    if let Some(filter) = &args.filter {
        let found = cases.len();
        cases.retain(|case| {
            let below = case.scenario.strip_prefix(&args.folder);
            let path = below.unwrap_or(&case.scenario).to_string_lossy();
            path.contains(filter.as_str())
        });
        if cases.is_empty() {
            let found = counted(found as u64, "scenario");
            return Err(CommandError::Input(anyhow!(
                "{folder} has {found}, and none with `{filter}` in its path"
            )));
        }
    }
    Ok(cases)
}

/// Runs one scenario.
fn verdict(case: &Case, missions: &mut BTreeMap<PathBuf, Compiled>, audience: Audience) -> Verdict {
    let mut verdict = Verdict {
        scenario: case.scenario.display().to_string(),
        mission: case.mission.as_ref().map(|path| path.display().to_string()),
        ..Verdict::default()
    };
    let Some(mission) = &case.mission else {
        let candidates = suite::candidates(&case.scenario);
        let candidates: Vec<_> = candidates
            .iter()
            .map(|path| path.display().to_string())
            .collect();
        let message = format!(
            "it has no mission: there is none of {}",
            candidates.join(", ")
        );
        verdict.failures.push(Fail::of_the_whole(message));
        return verdict;
    };
    let is_first = !missions.contains_key(mission);
    let compiled = missions
        .entry(mission.clone())
        .or_insert_with(|| compiled(mission));
    match compiled {
        Ok((blob, directory)) => match run(&case.scenario, blob, directory) {
            Ok((outcome, period_us, text)) => verdict.take(&outcome, period_us, &text),
            Err(failures) => verdict.failures = failures,
        },
        Err(cause) => {
            let message = if is_first || audience == Audience::Program {
                format!("its mission does not compile:\n{}", cause.trim_end())
            } else {
                "its mission does not compile: see above".to_owned()
            };
            verdict.failures.push(Fail::of_the_whole(message));
        }
    }
    verdict
}

/// Compiles a mission, or says why that does not go.
fn compiled(path: &Path) -> Compiled {
    let said = |error: CommandError| error.to_string();
    let mut checked = mission::read(path).map_err(said)?;
    checked.require_machine();
    let blob = mission::lay_out_and_compile(&mut checked, None, NameTable::Kept).map_err(said)?;
    let blob = blob.ok_or_else(|| {
        checked
            .diagnostics
            .retain(|found| found.severity() == Severity::Error);
        checked.render(false)
    })?;
    let directory = mission::names(&blob).map_err(said)?;
    Ok((blob, Arc::new(directory)))
}

/// Runs a scenario. Gives what came of it, the interpreter's period in microseconds, and the
/// scenario's text.
fn run(
    scenario: &Path,
    blob: &Verified<Vec<u8>>,
    directory: &Arc<Directory>,
) -> Result<(Outcome, u64, String), Vec<Fail>> {
    let whole = |message: String| vec![Fail::of_the_whole(message)];
    let text = file::read_text(scenario, "scenario").map_err(|error| whole(error.to_string()))?;
    let ports = Ports::of(&blob.tables(), directory);
    let bound = bind::read(&text, directory, &ports).map_err(|mistakes| {
        let fail = |mistake: crate::scenario::Mistake| Fail {
            line: Some(mistake.place.line),
            col: Some(mistake.place.col),
            message: format!("error: {}", mistake.cause),
            before: Vec::new(),
            timeline: Vec::new(),
        };
        mistakes.into_iter().map(fail).collect::<Vec<_>>()
    })?;
    let period_us = bound.period_us.unwrap_or(directory.interpreter_period_us());
    let outcome = sim::run(blob.clone(), directory, &bound, std::io::sink())
        .map_err(|error| whole(error.to_string()))?;
    Ok((outcome, u64::from(period_us), text))
}

impl Verdict {
    fn take(&mut self, outcome: &Outcome, period_us: u64, scenario: &str) {
        self.ok = outcome.is_good();
        self.macro_steps = outcome.steps;
        self.simulated_us = outcome.steps.saturating_sub(1) * period_us;
        self.met = outcome.met;
        for failure in &outcome.failures {
            self.failures.push(Fail {
                line: Some(failure.name.place.line),
                col: Some(failure.name.place.col),
                message: failure.to_string(),
                before: failure.before.iter().map(ToString::to_string).collect(),
                timeline: sim::timeline_text(&failure.timeline, scenario)
                    .lines()
                    .map(str::to_owned)
                    .collect(),
            });
        }
        if let Some((at, fault)) = &outcome.fault {
            let ms = milliseconds(at.t_us);
            let message = format!(
                "fault: {} in macro step {}, at {ms} ms",
                fault.code(),
                at.step
            );
            self.failures.push(Fail::of_the_whole(message));
        }
    }
}

/// One line for a scenario on standard output; what went wrong on standard error.
fn tell(verdict: &Verdict, console: &mut Console) -> Result<(), CommandError> {
    let Verdict {
        scenario,
        macro_steps,
        simulated_us,
        met,
        ..
    } = verdict;
    if verdict.ok {
        let expectations = counted(*met as u64, "expectation");
        let ms = milliseconds(*simulated_us);
        let steps = counted(*macro_steps, "macro step");
        writeln!(
            console.out(),
            "ok      {scenario}: {expectations} in {ms} ms, {steps}"
        )?;
        return Ok(());
    }
    writeln!(console.out(), "FAILED  {scenario}")?;
    for fail in &verdict.failures {
        let place = match (fail.line, fail.col) {
            (Some(line), Some(col)) => format!("{scenario}:{line}:{col}"),
            _ => scenario.clone(),
        };
        console.note(&format!("{place}: {}", fail.message));
        for moment in &fail.timeline {
            console.note(moment);
        }
    }
    Ok(())
}
