//! Finding or installing what building and running firmware needs: emulator, a compiler with a core
//! library for the board, linker.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use crate::process::{self, Failure, command, find_program, host_cargo, output};

/// The emulator, and its package in Debian and what descends from it.
const EMULATOR: (&str, &str) = ("qemu-system-arm", "qemu-system-arm");

/// What counts instructions on the host, and its package in Debian.
const VALGRIND: &str = "valgrind";

/// What the default board's core runs.
pub const BOARD_TARGET: &str = "thumbv7m-none-eabi";
/// The core that machines are measured on, where the compiler has a library for it.
const MEASURED_TARGET: &str = "thumbv7em-none-eabi";
/// Cores that everything that is no board must also compile for: a smaller one, and one of another
/// family, without compare-and-swap.
pub const OTHER_TARGETS: [&str; 2] = ["thumbv6m-none-eabi", "riscv32imc-unknown-none-elf"];

/// A core of ARMv8-M, with a floating-point unit.
const DOTTED_TARGET: &str = "thumbv8m.main-none-eabihf";

/// What pages in a browser run. It has no files, threads or clocks.
pub const PAGE_TARGET: &str = "wasm32-unknown-unknown";

/// The oldest compiler that the project's code is for; the workspace's `rust-version`.
const OLDEST_RUSTC: (u32, u32) = (1, 95);

/// How long `rustup target add` may take. Where its server is out of reach it would try for
/// minutes.
const RUSTUP_LIMIT: Duration = Duration::from_secs(30);

/// Debian's packages of the compiler, by release: backported for browsers in the stable releases,
/// plain in the newer ones.
const DEBIAN_PACKAGES: [[&str; 3]; 2] = [
    ["rustc-web", "cargo-web", "rust-web-src"],
    ["rustc", "cargo", "rust-src"],
];

/// Where Debian puts the compiler.
const DEBIAN_RUSTC: &str = "/usr/bin/rustc";
const DEBIAN_CARGO: &str = "/usr/bin/cargo";

/// Which compiler to use, as the user says it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Choice {
    /// rustup's if its target is there or can be had, else Debian's.
    Auto,
    /// rustup's, with `rustup target add`.
    Rustup,
    /// Debian's, with the core library built from its source package.
    Debian,
}

impl Choice {
    /// The choice of this name.
    ///
    /// # Errors
    /// [`Failure::Usage`] for any other name.
    pub fn from_name(name: &str) -> Result<Self, Failure> {
        match name {
            "auto" => Ok(Choice::Auto),
            "rustup" => Ok(Choice::Rustup),
            "debian" => Ok(Choice::Debian),
            _ => Err(Failure::Usage(format!(
                "toolchain `{name}` is none of rustup, debian, auto"
            ))),
        }
    }

    /// Its name, as [`Choice::from_name`] takes it.
    pub fn name(self) -> &'static str {
        match self {
            Choice::Auto => "auto",
            Choice::Rustup => "rustup",
            Choice::Debian => "debian",
        }
    }

    /// What `ESM_TOOLCHAIN` says.
    ///
    /// # Errors
    /// [`Failure::Usage`] if it names no toolchain.
    pub fn from_environment() -> Result<Self, Failure> {
        std::env::var("ESM_TOOLCHAIN").map_or(Ok(Choice::Auto), |name| Choice::from_name(&name))
    }
}

/// A compiler that can build firmware.
#[derive(Clone, Debug)]
pub enum Toolchain {
    /// The cargo that runs this program; the targets come from rustup.
    Rustup {
        /// Whether Debian's is taken for a target that rustup cannot give.
        or_debian: bool,
    },
    /// Debian's, which builds the core library from source.
    Debian {
        /// The linker: rustc's own `lld`.
        linker: PathBuf,
    },
}

impl Toolchain {
    /// The name of the choice that is this compiler.
    pub fn name(&self) -> &'static str {
        match self {
            Toolchain::Rustup { or_debian: true } => Choice::Auto.name(),
            Toolchain::Rustup { or_debian: false } => Choice::Rustup.name(),
            Toolchain::Debian { .. } => Choice::Debian.name(),
        }
    }

    /// A cargo command in `folder`, which builds with this compiler.
    pub fn cargo(&self, folder: &Path) -> Command {
        let mut cargo;
        match self {
            Toolchain::Rustup { .. } => {
                cargo = command(host_cargo());
                cargo.arg("--color=auto");
            }
            Toolchain::Debian { linker } => {
                cargo = command(DEBIAN_CARGO);
                // A core library from source is compiled like the firmware, for size: copying and
                // clearing memory would go byte by byte. The one that rustup gives is compiled for
                // speed.
                for package in ["core", "compiler_builtins"] {
                    let setting = format!("profile.release.package.{package}.opt-level=3");
                    cargo.args(["--config", &setting]);
                }
                // RUSTC_BOOTSTRAP lets a stable compiler take `-Zbuild-std`. What rustup's cargo
                // set for its children would mislead this one.
                // Where the name of a target has a dot, there is no variable for its linker.
                cargo.args([
                    "--config",
                    &format!(
                        "target.{DOTTED_TARGET}.linker={:?}",
                        linker.display().to_string()
                    ),
                ]);
                cargo
                    .env("RUSTC_BOOTSTRAP", "1")
                    .env("RUSTC", DEBIAN_RUSTC)
                    .env("CARGO_TARGET_THUMBV6M_NONE_EABI_LINKER", linker)
                    .env("CARGO_TARGET_THUMBV7M_NONE_EABI_LINKER", linker)
                    .env("CARGO_TARGET_THUMBV7EM_NONE_EABI_LINKER", linker)
                    .env("CARGO_TARGET_THUMBV7EM_NONE_EABIHF_LINKER", linker)
                    .env_remove("RUSTUP_TOOLCHAIN")
                    .env_remove("CARGO");
            }
        }
        cargo.current_dir(folder);
        cargo
    }

    /// The target of programs that are measured on a Cortex-M4: its own where there is a core
    /// library for it, and else the board's, whose core has the same instructions but for those of
    /// signal processing. Both are told to make code for a Cortex-M4.
    pub fn measured_core(&self) -> &'static str {
        match self {
            // Built from source.
            Toolchain::Debian { .. } => MEASURED_TARGET,
            Toolchain::Rustup { .. } if rustup_target(MEASURED_TARGET) => MEASURED_TARGET,
            Toolchain::Rustup { .. } => BOARD_TARGET,
        }
    }

    /// What the compiler says of its version.
    pub fn rustc_version(&self) -> String {
        let rustc = match self {
            Toolchain::Rustup { .. } => "rustc",
            Toolchain::Debian { .. } => DEBIAN_RUSTC,
        };
        let version = output(Command::new(rustc).arg("--version")).unwrap_or_default();
        version.trim().to_owned()
    }

    /// Further arguments of a cargo command outside the boards' folders, whose own settings have
    /// them.
    pub fn core_from_source(&self) -> &'static [&'static str] {
        match self {
            Toolchain::Rustup { .. } => &[],
            Toolchain::Debian { .. } => &["-Zbuild-std=core"],
        }
    }

    /// The same where the standard library is wanted.
    pub fn std_from_source(&self) -> &'static [&'static str] {
        match self {
            Toolchain::Rustup { .. } => &[],
            Toolchain::Debian { .. } => &["-Zbuild-std=std,panic_abort"],
        }
    }

    /// Whether the lints can be run on firmware: they need the lint driver and a core library of
    /// one compiler.
    pub fn has_clippy(&self) -> bool {
        match self {
            Toolchain::Rustup { .. } => true,
            Toolchain::Debian { .. } => Path::new("/usr/bin/clippy-driver").is_file(),
        }
    }
}

/// Finds or installs the emulator.
///
/// # Errors
/// [`Failure::Missing`] with the command that installs it.
pub fn emulator() -> Result<(), Failure> {
    let (program, package) = EMULATOR;
    if find_program(program).is_none() {
        install("the emulator", &[package])?;
    }
    let version = output(command(program).arg("--version")).unwrap_or_default();
    eprintln!("Emulator: {}", version.lines().next().unwrap_or(program));
    Ok(())
}

/// Finds or installs the program that counts instructions on the host.
///
/// # Errors
/// [`Failure::Missing`] with the command that installs it.
pub fn valgrind() -> Result<(), Failure> {
    if find_program(VALGRIND).is_none() {
        install("the counter of instructions", &[VALGRIND])?;
    }
    Ok(())
}

/// Finds or installs a compiler for firmware.
///
/// # Errors
/// [`Failure::Missing`] with the command that installs it.
pub fn toolchain(choice: Choice) -> Result<Toolchain, Failure> {
    let toolchain = match choice {
        Choice::Rustup => rustup_target(BOARD_TARGET)
            .then_some(Toolchain::Rustup { or_debian: false })
            .ok_or_else(|| Failure::Missing {
                what: format!("rustup's target {BOARD_TARGET}"),
                command: format!("rustup target add {BOARD_TARGET}"),
            })?,
        Choice::Debian => debian()?,
        Choice::Auto if rustup_target(BOARD_TARGET) => Toolchain::Rustup { or_debian: true },
        Choice::Auto => debian()?,
    };
    match &toolchain {
        Toolchain::Rustup { .. } => {
            eprintln!("Compiler for firmware: rustup's, target {BOARD_TARGET}");
        }
        Toolchain::Debian { linker } => eprintln!(
            "Compiler for firmware: Debian's {DEBIAN_RUSTC}, core library from source, linker {}",
            linker.display()
        ),
    }
    Ok(toolchain)
}

/// The compiler for another target than the default board's: `toolchain`, or Debian's, where rustup
/// cannot give the target and the choice was free.
///
/// # Errors
/// [`Failure::Missing`] with the command that installs it.
pub fn another_target(toolchain: &Toolchain, target: &str) -> Result<Toolchain, Failure> {
    match toolchain {
        Toolchain::Rustup { or_debian } if !rustup_target(target) => match or_debian {
            true => debian(),
            false => Err(Failure::Missing {
                what: format!("rustup's target {target}"),
                command: format!("rustup target add {target}"),
            }),
        },
        Toolchain::Rustup { .. } | Toolchain::Debian { .. } => Ok(toolchain.clone()),
    }
}

/// A compiler that checks the library without an operating system: rustup's if its target is there
/// or can be had, else Debian's.
///
/// # Errors
/// [`Failure::Missing`] with the command that installs it.
pub fn page_toolchain(choice: Choice) -> Result<Toolchain, Failure> {
    match choice {
        Choice::Auto | Choice::Rustup if rustup_target(PAGE_TARGET) => {
            Ok(Toolchain::Rustup { or_debian: true })
        }
        Choice::Rustup => Err(Failure::Missing {
            what: format!("rustup's target {PAGE_TARGET}"),
            command: format!("rustup target add {PAGE_TARGET}"),
        }),
        Choice::Auto | Choice::Debian => debian(),
    }
}

/// Whether rustup is there and has `target`, which it is told to fetch if it has not.
fn rustup_target(target: &str) -> bool {
    if find_program("rustup").is_none() {
        return false;
    }
    let installed = output(command("rustup").args(["target", "list", "--installed"]));
    if installed.is_some_and(|list| list.lines().any(|line| line.trim() == target)) {
        return true;
    }
    /// Targets that could not be had: they are asked for once in a run.
    static REFUSED: Mutex<Vec<String>> = Mutex::new(Vec::new());
    let mut refused = REFUSED.lock().unwrap_or_else(PoisonError::into_inner);
    if refused.iter().any(|it| it == target) {
        return false;
    }
    eprintln!("Fetching the target {target} with `rustup target add {target}` …");
    if process::run_within(
        command("rustup").args(["target", "add", target]),
        RUSTUP_LIMIT,
    ) {
        return true;
    }
    eprintln!("rustup gave no target within {} s.", RUSTUP_LIMIT.as_secs());
    refused.push(target.to_owned());
    false
}

/// Finds or installs Debian's compiler, its sources and a linker.
fn debian() -> Result<Toolchain, Failure> {
    if !debian_is_complete() {
        // Lists of packages may be older than the compiler that is wanted, or not be there at all.
        let packages = debian_packages().or_else(|| {
            Apt::find()?.update_lists().ok()?;
            debian_packages()
        });
        let packages = packages.ok_or_else(|| Failure::Missing {
            what: format!(
                "a compiler for {BOARD_TARGET} (no Debian package has rustc {}.{} or newer)",
                OLDEST_RUSTC.0, OLDEST_RUSTC.1
            ),
            command: format!("rustup target add {BOARD_TARGET}"),
        })?;
        install("a compiler that can build for the board", &packages)?;
    }
    let linker = match find_linker() {
        Some(linker) => linker,
        None => {
            install("the linker", &[&linker_package()])?;
            find_linker().ok_or_else(|| Failure::Missing {
                what: "the linker rust-lld".into(),
                command: format!("apt-get install {}", linker_package()),
            })?
        }
    };
    Ok(Toolchain::Debian { linker })
}

/// Whether Debian's compiler is there, new enough, with cargo and the sources of the core library.
fn debian_is_complete() -> bool {
    let version = output(Command::new(DEBIAN_RUSTC).arg("--version"));
    let sysroot = output(Command::new(DEBIAN_RUSTC).args(["--print", "sysroot"]));
    let (Some(version), Some(sysroot)) = (version, sysroot) else {
        return false;
    };
    let new_enough = version.split(' ').nth(1).is_some_and(is_new_enough);
    let sources = Path::new(sysroot.trim()).join("lib/rustlib/src/rust/library/core");
    new_enough && sources.is_dir() && Path::new(DEBIAN_CARGO).is_file()
}

/// The first set of packages whose compiler is new enough.
fn debian_packages() -> Option<[&'static str; 3]> {
    DEBIAN_PACKAGES.into_iter().find(|[rustc, ..]| {
        let policy = output(Command::new("apt-cache").args(["policy", rustc]));
        policy.is_some_and(|policy| {
            policy
                .lines()
                .filter_map(|line| line.trim().strip_prefix("Candidate: "))
                .any(is_new_enough)
        })
    })
}

/// Whether a version such as `1.96.0+dfsg1-1` is [`OLDEST_RUSTC`] or newer.
fn is_new_enough(version: &str) -> bool {
    let mut numbers = version.split('.').map_while(|number| number.parse().ok());
    let version = (numbers.next().unwrap_or(0), numbers.next().unwrap_or(0));
    version >= OLDEST_RUSTC
}

/// A linker that rustc drives as its own: on the search path, or in a toolchain of rustup's.
fn find_linker() -> Option<PathBuf> {
    const LINKER: &str = "rust-lld";
    find_program(LINKER).or_else(|| {
        let sysroot = output(Command::new("rustc").args(["--print", "sysroot"]))?;
        let host = output(Command::new("rustc").args(["--print", "host-tuple"]))?;
        let linker = Path::new(sysroot.trim())
            .join("lib/rustlib")
            .join(host.trim())
            .join("bin")
            .join(LINKER);
        linker.is_file().then_some(linker)
    })
}

/// The package of the linker: Debian's `rust-lld` is a link to the `lld` of the LLVM that its
/// compiler was built with, in a package of that name.
fn linker_package() -> String {
    std::fs::read_link("/usr/bin/rust-lld")
        .ok()
        .and_then(|target| Some(target.file_name()?.to_str()?.to_owned()))
        .unwrap_or_else(|| "lld".into())
}

/// Installs packages with apt, as root or through sudo.
///
/// # Errors
/// [`Failure::Missing`] with the command that does it.
pub fn install(what: &str, packages: &[&str]) -> Result<(), Failure> {
    let missing = || Failure::Missing {
        what: format!("{what} ({})", packages.join(", ")),
        command: format!("sudo apt-get install {}", packages.join(" ")),
    };
    let apt = Apt::find().ok_or_else(missing)?;
    let arguments = [&["install", "-y", "--no-install-recommends"][..], packages].concat();
    eprintln!(
        "Installing {what}: `apt-get install {}` …",
        packages.join(" ")
    );
    (apt.run(&arguments))
        .or_else(|_| apt.update_lists().and_then(|()| apt.run(&arguments)))
        .map_err(|_| missing())
}

/// apt-get, and the right to use it.
struct Apt {
    /// What to put before a command that needs root.
    prefix: &'static [&'static str],
}

impl Apt {
    /// `None` where there is no apt-get, or this user may not use it.
    fn find() -> Option<Self> {
        find_program("apt-get")?;
        root_prefix().map(|prefix| Apt { prefix })
    }

    /// Fetches the lists of packages.
    fn update_lists(&self) -> Result<(), Failure> {
        eprintln!("Fetching the lists of packages first: `apt-get update` …");
        self.run(&["update"])
    }

    fn run(&self, arguments: &[&str]) -> Result<(), Failure> {
        let mut words = self.prefix.iter().chain(&["apt-get"]).chain(arguments);
        let mut apt = command(words.next().unwrap_or(&"apt-get"));
        #[expect(
            clippy::disallowed_methods,
            reason = "what apt-get says goes on as it is, and not where a program may read"
        )]
        let terminal = std::io::stderr();
        apt.args(words)
            .env("DEBIAN_FRONTEND", "noninteractive")
            .stdout(terminal);
        process::run(&mut apt)
    }
}

/// What to put before a command that needs root; `None` if this user cannot become root without
/// being asked for a password.
fn root_prefix() -> Option<&'static [&'static str]> {
    if output(Command::new("id").arg("-u"))?.trim() == "0" {
        return Some(&[]);
    }
    find_program("sudo")?;
    output(Command::new("sudo").args(["-n", "true"])).map(|_| &["sudo", "-n"][..])
}

#[cfg(test)]
mod tests {
    use super::is_new_enough;

    #[test]
    fn versions_are_compared_by_number() {
        for (version, expected) in [
            ("1.96.0+dfsg1-1~deb12u2", true),
            ("1.95.0", true),
            ("1.100.0", true),
            ("2.0.0", true),
            ("1.85.0+dfsg3-1", false),
            ("1.9.0", false),
            ("(none)", false),
            ("", false),
        ] {
            assert_eq!(is_new_enough(version), expected, "{version}");
        }
    }
}
