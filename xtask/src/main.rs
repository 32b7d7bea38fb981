//! The project's own commands: `cargo xtask demo`, `test`, `bench`, `fuzz`, `firmware`, `size`,
//! `release`, `setup`, `studio`.
//!
//! What needs the network, root or minutes is told before it is done. What cannot be done ends with
//! the exact command that would. There are no dependencies, so that the first command on a fresh
//! machine starts at once.

mod bench;
mod campaign;
mod demo;
mod elf;
mod firmware;
mod form;
mod fuzz;
mod interpreters;
mod missions;
mod mutants;
mod process;
mod python;
mod release;
mod setup;
mod size;
mod studio;
mod tally;
mod test;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use process::Failure;
use setup::Choice;

const HELP: &str = "\
The project's own commands.

Usage: cargo xtask <COMMAND> [OPTIONS] [TARGET]...

Commands:
  demo       Build everything, drive the robot in the emulator through two missions, and put pictures and traces in target/demo
  test       Run every check that CI runs; ends with a line `N passed, M failed`. TARGET: only such a part of them: checks (form, lints, documentation,
             mutants), builds (firmware, sizes, the command), robots (the demo, tests of the whole, which need the builds), libraries
  campaign   Run tests at full length of which `test` does a small part: each TARGET; without one, list them and how long they take
  bench      Measure and print tables: what an event takes, of compiled state machines and of the interpreter, on the host and on a Cortex-M4, with what has been
             promised of it; `bench --help` tells its options, and what else can be measured (machines, interpreters, schedule, dispatch, day, idle, link, record, walk, bound)
  fuzz       Look for inputs that go wrong, with libFuzzer: each TARGET, or all of fuzz/fuzz_targets, one after another
  firmware   Build a board's firmware to target/firmware/BOARD/<BIN>.elf
  emulator   Install the emulator of a board's chip below target/emulators, and say what was done
  size       Print flash and RAM of the firmware, part by part, and what missions take, and compare them with boards/BOARD/expected-size.txt
  studio     Build the studio's engine and page to studio/dist, and print what they take
  mutants    Make small changes for the worse, those in tests/mutants, and see whether a test notices: each TARGET, or all of them
  form       Look for lines that are too wide, in .rs and .md files, as `test checks` does
  release    Make the files of a release in target/release-files: packages, the command esm, firmware of each board (ELF, UF2), notes, sums
  setup      Find or install what the others need (emulator, compiler for the board, linker), and say what was done

Options:
  --toolchain <rustup|debian|auto>   Which compiler builds firmware (also ESM_TOOLCHAIN) [default: auto]:
                                     rustup's with its target installed, or Debian's, which builds the core library from source
  --bin <NAME>                       firmware: what to build, may be repeated [default: rover]
  --board <NAME>                     firmware, emulator, size: the board, one of those in boards/ [default: that of QEMU]
  --hardware                         firmware: build the default firmware of --board for a part of silicon, where it is another than the emulator's,
                                     to rover-hardware.elf
  --example                          firmware: build examples/my_robot instead
  --robot <FOLDER>                   firmware: build the robot in FOLDER, as `esm new robot` makes one, for its board
  --lean                             firmware: build the default firmware without its features, to rover-lean.elf
  --with <FEATURE>                   firmware: build a board's firmware with a feature of the board that it lacks by default, to rover-FEATURE.elf
  --quick                            test: leave out what takes minutes (emulator, my_robot)
  --out <DIR>                        release: where its files go, a folder that is not there, or is empty
  --notes <PART>                     release: the part of CHANGELOG.md that its notes are, such as 0.1.0 [default: Unreleased, else that of the version]
  --allow-dirty                      release: what is not committed is in it, too
  --minutes <N>                      fuzz: how long each target runs [default: 5]
  --write                            size: keep the sizes as the expected ones; form: keep today's wide lines as the allowed ones
  -h, --help                         This text
";

/// The command line.
#[derive(Debug, Default)]
struct Options {
    toolchain: Option<Choice>,
    bins: Vec<String>,
    board: Option<String>,
    hardware: bool,
    example: bool,
    robot: Option<PathBuf>,
    lean: bool,
    with: Option<String>,
    quick: bool,
    write: bool,
    minutes: Option<u32>,
    out: Option<PathBuf>,
    notes: Option<String>,
    allow_dirty: bool,
    targets: Vec<String>,
}

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1);
    let command = arguments.next();
    let result = match command.as_deref() {
        None | Some("-h" | "--help" | "help") => {
            print!("{HELP}");
            Ok(())
        }
        // What is measured has options of its own.
        Some("bench") => root().and_then(|root| bench::command(&root, arguments)),
        Some(command) => parse(arguments).and_then(|options| run(command, &options)),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(Failure::Usage(problem)) => {
            eprintln!("xtask: {problem}\n\n{HELP}");
            ExitCode::from(2)
        }
        Err(failure) => {
            eprintln!("xtask: {failure}");
            ExitCode::from(failure.status())
        }
    }
}

/// Prints where files are, one a line.
fn print_files(files: Vec<PathBuf>) {
    for file in files {
        println!("{}", file.display());
    }
}

fn parse(mut arguments: impl Iterator<Item = String>) -> Result<Options, Failure> {
    let mut options = Options::default();
    while let Some(argument) = arguments.next() {
        let (name, mut given) = match argument.split_once('=') {
            Some((name, value)) => (name.to_owned(), Some(value.to_owned())),
            None => (argument, None),
        };
        let mut value = || {
            given
                .take()
                .or_else(|| arguments.next())
                .ok_or_else(|| Failure::Usage(format!("{name} needs a value")))
        };
        match name.as_str() {
            "--toolchain" => options.toolchain = Some(Choice::from_name(&value()?)?),
            "--bin" => options.bins.push(value()?),
            "--board" => options.board = Some(value()?),
            "--hardware" => options.hardware = true,
            "--example" => options.example = true,
            "--robot" => options.robot = Some(value()?.into()),
            "--lean" => options.lean = true,
            "--with" => options.with = Some(value()?),
            "--quick" => options.quick = true,
            "--write" => options.write = true,
            "--out" => options.out = Some(value()?.into()),
            "--notes" => options.notes = Some(value()?),
            "--allow-dirty" => options.allow_dirty = true,
            "--minutes" => {
                let minutes = value()?;
                let right = minutes.parse().ok().filter(|minutes| *minutes >= 1);
                let wrong = || Failure::Usage(format!("--minutes {minutes}: a number from 1 on"));
                options.minutes = Some(right.ok_or_else(wrong)?);
            }
            "-h" | "--help" => {
                print!("{HELP}");
                std::process::exit(0);
            }
            target if !target.starts_with('-') => {
                options.targets.push(target.to_owned());
            }
            _ => return Err(Failure::Usage(format!("unknown option {name}"))),
        }
    }
    Ok(options)
}

fn run(command: &str, options: &Options) -> Result<(), Failure> {
    let takes_words = matches!(command, "campaign" | "fuzz" | "mutants" | "test");
    if let Some(surplus) = options.targets.first().filter(|_| !takes_words) {
        return Err(Failure::Usage(format!("{command} takes no {surplus}")));
    }
    let choice = match options.toolchain {
        Some(choice) => choice,
        None => Choice::from_environment()?,
    };
    let root = root()?;
    match command {
        "setup" => {
            setup::emulator()?;
            setup::toolchain(choice)?;
            println!(
                "Ready: `cargo xtask demo` shows the robot, `cargo xtask test` runs all checks."
            );
            Ok(())
        }
        "firmware" => {
            let names_robot = options.example || options.robot.is_some();
            let is_variant = options.lean || options.with.is_some();
            if options.hardware && (names_robot || is_variant || !options.bins.is_empty()) {
                return Err(Failure::Usage(
                    "--hardware builds the default firmware of a board: give it with --board alone"
                        .to_owned(),
                ));
            }
            if options.board.is_some() && (names_robot || options.lean) {
                return Err(Failure::Usage(
                    "--example and --lean are of the default board, and a --robot names its own: \
                     leave --board out"
                        .to_owned(),
                ));
            }
            let toolchain = setup::toolchain(choice)?;
            if options.example {
                return firmware::build_example(&root, &toolchain).map(print_files);
            }
            if let Some(robot) = &options.robot {
                let bins = &options.bins;
                return firmware::build_robot(&root, robot, &toolchain, bins).map(print_files);
            }
            if options.lean {
                return firmware::build_lean(&root, &toolchain).map(print_files);
            }
            if let Some(feature) = &options.with {
                let board = options.board.as_deref().unwrap_or(firmware::DEFAULT_BOARD);
                let bins = [firmware::DEFAULT_BIN.to_owned()];
                return firmware::build_with(&root, board, feature, &toolchain, &bins)
                    .map(print_files);
            }
            let default = [firmware::DEFAULT_BIN.to_owned()];
            let bins = if options.bins.is_empty() {
                &default[..]
            } else {
                &options.bins
            };
            if options.hardware {
                let board = options.board.as_deref().unwrap_or(firmware::DEFAULT_BOARD);
                return firmware::build_hardware(&root, board, &toolchain).map(print_files);
            }
            if let Some(board) = &options.board {
                return firmware::build_for(&root, board, &toolchain, bins).map(print_files);
            }
            firmware::build(&root, &toolchain, firmware::RELEASE, bins).map(print_files)
        }
        "emulator" => match options.board.as_deref() {
            None => setup::emulator(),
            Some(board) if firmware::is_of_qemu(&root, board) => setup::emulator(),
            Some(board) => python::emulator(&root, board),
        },
        "size" => {
            let toolchain = setup::toolchain(choice)?;
            match options.board.as_deref() {
                None | Some(firmware::DEFAULT_BOARD) => {
                    size::command(&root, &toolchain, options.write)
                }
                Some(board) => size::of_board(&root, board, &toolchain, options.write),
            }
        }
        "test" => test::command(
            &root,
            test::Selection {
                parts: &options.targets,
                quick: options.quick,
                toolchain: choice,
            },
        ),
        "studio" => studio::command_line(&root, &setup::page_toolchain(choice)?),
        "mutants" => mutants::command(&root, &options.targets),
        "release" => release::command(
            &root,
            choice,
            release::Wanted {
                out: options.out.as_deref(),
                notes: options.notes.as_deref(),
                allow_dirty: options.allow_dirty,
            },
        ),
        "form" => form::command(&root, options.write),
        "campaign" => campaign::command(&root, &options.targets, || setup::toolchain(choice)),
        "demo" => demo::command(&root, choice),
        "fuzz" => {
            let minutes = options.minutes.unwrap_or(fuzz::DEFAULT_MINUTES);
            fuzz::command_line(&root, &options.targets, minutes)
        }
        unknown => Err(Failure::Usage(format!("unknown command {unknown}"))),
    }
}

/// What a checkout has below its top and nobody else does.
const CHECKOUT_MARK: &str = "xtask/src/main.rs";

/// The top of the checkout that this is run in. It need not be the one that this was compiled in:
/// cargo does not build again what was copied or moved together with its `target` folder.
fn root() -> Result<PathBuf, Failure> {
    let folder = std::env::current_dir().map_err(|cause| Failure::File {
        path: ".".into(),
        cause,
    })?;
    let top = (folder.ancestors()).find(|folder| folder.join(CHECKOUT_MARK).is_file());
    match top.map(Path::to_owned) {
        Some(top) => Ok(top),
        None => Err(Failure::NoCheckout { folder }),
    }
}
