//! Calibrates what constructs of a macro step cost and holds the bounds against what is measured:
//! what `cargo xtask bench bound` starts.
//!
//! Its argument is the firmware, `boards/lm3s6965/src/bin/bench_bound.rs`; with `--write` the costs
//! that it finds are kept in [`COSTS`]. What it prints last are the tables of the book.

use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use esm_tests::calibration::{self, Sample};
use esm_tests::command::root;
use esm_tests::instructions::{self, MAX_ARENA_WORDS, MAX_BLOB_BYTES, Run};
use esm_tests::{random_machine, subject};
use host_tools::bound::costs::Construct;
use host_tools::bound::search::{Effort, Input, Subject};
use host_tools::bound::{Costs, bound};

/// Where the costs are kept.
const COSTS: &str = "boards/lm3s6965/costs.txt";
/// Macro steps of each example.
const EXAMPLE_STEPS: usize = 24;
/// Runs of each example.
const EXAMPLE_RUNS: u64 = 3;
/// Random machines that the costs are fitted to.
const FITTED: std::ops::Range<u64> = 0..800;
/// Random machines that they are then held against.
const HELD: std::ops::Range<u64> = 1_000..1_250;
/// Macro steps of each.
const RANDOM_STEPS: usize = 20;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let writes = arguments.iter().any(|argument| argument == "--write");
    let firmware = arguments
        .iter()
        .find(|argument| !argument.starts_with("--"));
    let Some(firmware) = firmware else {
        eprintln!("the calibration needs a firmware: cargo xtask bench bound");
        return ExitCode::from(2);
    };
    match bench(Path::new(firmware), writes) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(1),
        Err(error) => {
            eprintln!("the calibration: {error}");
            ExitCode::from(3)
        }
    }
}

/// A mission and runs of it.
struct Measured {
    name: String,
    blob: Vec<u8>,
    inputs: Vec<Vec<Input>>,
}

impl Measured {
    /// A mission of which `runs` are drawn; none where the firmware has no room for it.
    fn drawn(name: String, blob: Vec<u8>, steps: usize, runs: u64) -> Result<Option<Self>, String> {
        let verified = subject::verified(&blob)?;
        if blob.len() > MAX_BLOB_BYTES || verified.arena_words() > MAX_ARENA_WORDS {
            return Ok(None);
        }
        let subject = Subject::new(&verified).ok_or("a blob that is not verified twice")?;
        let inputs = (0..runs)
            .map(|seed| subject.wander(steps, seed))
            .map(|inputs| {
                // A run ends with a fault.
                let ran = subject.run(&inputs).len();
                inputs.into_iter().take(ran).collect()
            });
        let inputs = inputs.collect();
        Ok(Some(Measured { name, blob, inputs }))
    }
}

/// What macro steps consisted of and took, by mission.
fn samples(firmware: &Path, missions: &[Measured]) -> Result<Vec<Vec<Sample>>, Box<dyn Error>> {
    let runs: Vec<Run<'_>> = missions
        .iter()
        .flat_map(|mission| {
            mission.inputs.iter().map(|inputs| Run {
                blob: &mission.blob,
                inputs,
            })
        })
        .collect();
    let mut counts = instructions::count(firmware, &runs)?.into_iter();
    let mut samples = Vec::new();
    for mission in missions {
        let verified = subject::verified(&mission.blob)?;
        let subject = Subject::new(&verified).ok_or("a blob that is not verified twice")?;
        let mut of_mission = Vec::new();
        for inputs in &mission.inputs {
            let ran = subject.run(inputs);
            let instructions = counts.next().unwrap_or_default();
            of_mission.extend(
                ran.iter()
                    .zip(instructions)
                    .map(|(ran, instructions)| Sample {
                        counts: ran.counts,
                        instructions,
                    }),
            );
        }
        samples.push(of_mission);
    }
    Ok(samples)
}

fn random_machines(seeds: std::ops::Range<u64>) -> Result<Vec<Measured>, Box<dyn Error>> {
    let mut machines = Vec::new();
    for seed in seeds {
        let built = subject::build(&random_machine::machine(seed))?;
        machines.extend(Measured::drawn(
            format!("random machine {seed}"),
            built.blob,
            RANDOM_STEPS,
            1,
        )?);
    }
    Ok(machines)
}

/// Finds costs, and holds them and the bounds against measurements. False if something takes longer
/// than it should.
fn bench(firmware: &Path, writes: bool) -> Result<bool, Box<dyn Error>> {
    let mut missions = Vec::new();
    for example in calibration::examples() {
        let built = subject::build(&example.text)?;
        missions.extend(Measured::drawn(
            example.name,
            built.blob,
            EXAMPLE_STEPS,
            EXAMPLE_RUNS,
        )?);
    }
    missions.extend(random_machines(FITTED)?);
    let of_missions = samples(firmware, &missions)?;
    let all: Vec<Sample> = of_missions.iter().flatten().copied().collect();
    let costs = calibration::fit(&all);
    println!("{} macro steps of {} missions", all.len(), missions.len());
    let kept = root().join(COSTS);
    if writes {
        fs::write(&kept, format!("{COSTS_HEADER}{costs}"))?;
    }
    let kept = Costs::parse(&fs::read_to_string(kept)?)?;
    println!("\n| construct | instructions, kept | found now |\n|---|---|---|");
    for construct in Construct::ALL {
        let (kept, found) = (kept.of(construct), costs.of(construct));
        println!("|{} | {kept} | {found} |", construct.says());
    }
    let mut holds = held("example", &missions, &of_missions, &kept)?;
    let others = random_machines(HELD)?;
    let of_others = samples(firmware, &others)?;
    holds &= held("random machine", &others, &of_others, &kept)?;
    holds &= shipped(firmware, &kept)?;
    Ok(holds)
}

const COSTS_HEADER: &str = "# Instructions that each construct of a macro step takes at most: the interpreter of the shipped firmware (`release` of boards/lm3s6965, fat LTO) on the Cortex-M3.\n\
     # Written by `cargo xtask bench bound --write`; a test holds it against new measurements.\n";

/// Whether no macro step took more than its constructs cost, and than the bound of its mission.
fn held(
    what: &str,
    missions: &[Measured],
    samples: &[Vec<Sample>],
    costs: &Costs,
) -> Result<bool, Box<dyn Error>> {
    let mut holds = true;
    let (mut steps, mut measured, mut counted) = (0, 0, 0);
    for (mission, samples) in missions.iter().zip(samples) {
        let verified = subject::verified(&mission.blob)?;
        let subject = Subject::new(&verified).ok_or("a blob that is not verified twice")?;
        let bound = bound(subject.machine(), costs).instructions;
        for (step, sample) in samples.iter().enumerate() {
            let cost = costs.total(&sample.counts);
            steps += 1;
            measured += sample.instructions;
            counted += cost;
            if cost < sample.instructions || bound < sample.instructions {
                holds = false;
                println!(
                    "{}, step {step}: {} instructions, {cost} counted, bound {bound}: {:?}",
                    mission.name, sample.instructions, sample.counts
                );
            }
        }
    }
    println!(
        "\n{} macro steps of {} missions ({what}s): what is counted is {:.2} times what is measured",
        steps,
        missions.len(),
        counted as f64 / measured.max(1) as f64
    );
    Ok(holds)
}

/// The most that the bound of a shipped mission may be, as a multiple of the longest macro step
/// that is found.
const MOST: u64 = 2;

/// The table of the shipped missions.
fn shipped(firmware: &Path, costs: &Costs) -> Result<bool, Box<dyn Error>> {
    let mut holds = true;
    println!(
        "\n| mission | bound | worst found | measured | bound / measured |\n|---|---|---|---|---|"
    );
    for file in files()? {
        let built = subject::build_file(&file)?;
        let verified = subject::verified(&built.blob)?;
        let subject = Subject::new(&verified).ok_or("a blob that is not verified twice")?;
        let bound = bound(subject.machine(), costs).instructions;
        let found = subject.search(costs, Effort::USUAL, 1);
        let run = Run {
            blob: &built.blob,
            inputs: &found.inputs,
        };
        let measured = instructions::count(firmware, &[run])?;
        let most = measured.iter().flatten().copied().max().unwrap_or_default();
        holds &= most <= bound && bound <= MOST * most;
        println!(
            "| {} | {bound} | {} | {most} | {:.2} |",
            file.strip_prefix(root())?.display(),
            found.instructions,
            bound as f64 / most.max(1) as f64
        );
    }
    Ok(holds)
}

/// The missions that ship.
fn files() -> Result<Vec<PathBuf>, Box<dyn Error>> {
    let mut files = Vec::new();
    for folder in ["missions", "missions/tutorial"] {
        for entry in fs::read_dir(root().join(folder))? {
            let path = entry?.path();
            let is_mission = path.extension().is_some_and(|it| it == "esm")
                && fs::read_to_string(&path)?.contains("\nmachine ");
            if is_mission {
                files.push(path);
            }
        }
    }
    files.push(root().join("tests/data/cd51.esm"));
    files.sort();
    Ok(files)
}
