//! The studio: the engine as a module, the page as scripts and styles, and what both are held
//! against.
//!
//! What is built lies in `studio/dist` and is committed, so that who builds `esm` needs neither
//! Node nor another target. Scripts are built from their sources to the same bytes everywhere, and
//! so are compared with what is committed. The module's bytes depend on the compiler, and so what
//! it does is compared: its traces and diagnostics with the command's.

use std::fs;
use std::path::{Path, PathBuf};

use crate::process::{self, Failure, command, find_program};
use crate::setup::{self, PAGE_TARGET, Toolchain};

pub const ENGINE_FOLDER: &str = "studio/engine";
const PAGE_FOLDER: &str = "studio/page";
/// What is committed, and what is embedded in the command.
const DIST_FOLDER: &str = "studio/dist";
/// Where the engine is built, and the page once more.
const TARGET_FOLDER: &str = "target/studio";
const MODULE: &str = "wasm32-unknown-unknown/release/studio_engine.wasm";

/// What is compared byte for byte.
const SCRIPTS: [&str; 5] = [
    "index.html",
    "studio.css",
    "studio.js",
    "worker.js",
    "licenses.txt",
];

/// Stack of the module, in bytes: as much as the largest parts of a robot's memory take while they
/// are made.
const STACK_BYTES: usize = 8 * 1024 * 1024;

/// What the module may take at most, packed, in bytes.
const MODULE_LIMIT: usize = 1_100_000;

/// Where browsers are that the tests can drive.
const BROWSERS: [&str; 3] = ["chromium", "chromium-browser", "google-chrome"];

/// Builds engine and page to where they are committed.
///
/// # Errors
/// What is missing, or did not work.
pub fn command_line(root: &Path, toolchain: &Toolchain) -> Result<(), Failure> {
    require_node()?;
    install(root)?;
    let module = build_engine(root, toolchain)?;
    build_page(root, &root.join(DIST_FOLDER), Some(&module))?;
    measure(root)
}

/// Installs what the page is tested with, where it is missing: Node, and a browser.
///
/// # Errors
/// [`Failure::Missing`] with the command that does it.
pub fn prepare() -> Result<(), Failure> {
    if find_program("npm").is_none() || find_program("node").is_none() {
        setup::install("Node, which runs the studio", &["nodejs", "npm"])?;
    }
    if !BROWSERS.iter().any(|it| find_program(it).is_some()) {
        // With letters, which a browser alone does not bring.
        let packages = ["chromium", "fonts-liberation"];
        setup::install("a browser, which tests the studio", &packages)?;
    }
    Ok(())
}

/// Looks whether what is committed is what its sources make, and does what the command does.
///
/// # Errors
/// [`Failure::Content`] where it is not fresh; or what did not work.
pub fn test_fresh(root: &Path, esm: &Path) -> Result<(), Failure> {
    install(root)?;
    process::run(
        command("npm")
            .args(["run", "types"])
            .current_dir(root.join(PAGE_FOLDER)),
    )?;
    let built = root.join(TARGET_FOLDER).join("page");
    build_page(root, &built, None)?;
    for name in SCRIPTS {
        let committed = root.join(DIST_FOLDER).join(name);
        if read(&committed)? != read(&built.join(name))? {
            return Err(Failure::Content {
                path: committed,
                problem: "is not what its sources make: run `cargo xtask studio` and commit it",
            });
        }
    }
    node(root, "traces.mjs", &[esm, root, &root.join(DIST_FOLDER)])
}

/// Drives the page in a browser, as the command serves it.
///
/// # Errors
/// What did not work.
pub fn test_page(root: &Path, esm: &Path) -> Result<(), Failure> {
    let pictures = root.join("target/studio/pictures");
    node(root, "page.mjs", &[esm, root, &pictures])
}

/// Prints what the studio takes, and holds the size of the module against its limit.
fn measure(root: &Path) -> Result<(), Failure> {
    let dist = root.join(DIST_FOLDER);
    node(root, "measure.mjs", &[root, &dist])?;
    let module = dist.join("engine.wasm.gz");
    if read(&module)?.len() > MODULE_LIMIT {
        return Err(Failure::Content {
            path: module,
            problem: "is larger than a page should load",
        });
    }
    Ok(())
}

fn require_node() -> Result<(), Failure> {
    match find_program("npm") {
        Some(_) => Ok(()),
        None => Err(Failure::Missing {
            what: "Node with npm, which builds the studio's page".to_owned(),
            command: "apt-get install nodejs npm".to_owned(),
        }),
    }
}

/// Installs what the page is made of, at the versions that are pinned.
fn install(root: &Path) -> Result<(), Failure> {
    let words = ["ci", "--no-audit", "--no-fund", "--loglevel=error"];
    process::run(
        command("npm")
            .args(words)
            .current_dir(root.join(PAGE_FOLDER)),
    )
}

fn build_engine(root: &Path, toolchain: &Toolchain) -> Result<PathBuf, Failure> {
    let target = root.join(TARGET_FOLDER);
    process::run(
        toolchain
            .cargo(&root.join(ENGINE_FOLDER))
            .args(["build", "--release", "--locked", "--target", PAGE_TARGET])
            .args(toolchain.std_from_source())
            .arg("--target-dir")
            .arg(&target)
            .env(
                "RUSTFLAGS",
                format!("-Clink-arg=-zstack-size={STACK_BYTES}"),
            ),
    )?;
    Ok(target.join(MODULE))
}

fn build_page(root: &Path, out: &Path, module: Option<&Path>) -> Result<(), Failure> {
    process::run(
        command("node")
            .arg("build.mjs")
            .arg(out)
            .args(module)
            .current_dir(root.join(PAGE_FOLDER)),
    )
}

fn node(root: &Path, script: &str, arguments: &[&Path]) -> Result<(), Failure> {
    process::run(
        command("node")
            .arg(Path::new("test").join(script))
            .args(arguments)
            .current_dir(root.join(PAGE_FOLDER)),
    )
}

fn read(path: &Path) -> Result<Vec<u8>, Failure> {
    fs::read(path).map_err(|cause| Failure::File {
        path: path.to_owned(),
        cause,
    })
}
