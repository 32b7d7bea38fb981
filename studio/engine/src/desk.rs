//! What a text is worked on with: the language server, the compiler, the diagram.

use std::cell::{Cell, RefCell};
use std::collections::{BTreeSet, VecDeque};
use std::time::Duration;

use esm_core::Verified;
use esm_toolkit::boards;
use esm_toolkit::compile::NameTable;
use esm_toolkit::diagram::{self, Options};
use esm_toolkit::fit;
use esm_toolkit::lang::{self, Checked};
use esm_toolkit::language_server::{Incoming, Session};
use esm_toolkit::schedule::Limit;
use lsp_server::Message;
use serde::Serialize;
use serde_json::{Value, json};

use crate::files::Files;

/// Pieces of work for start times: `esm` searches for 5 s, and what is found at all is found within
/// far fewer.
const SEARCH_PIECES: u64 = 2_000_000;

thread_local! {
    static NOW_MS: Cell<f64> = const { Cell::new(0.0) };
    static FILES: &'static Files = Box::leak(Box::new(Files::new()));
    static SERVER: RefCell<Session<'static>> = RefCell::new(Session::new(files(), now));
}

/// The files of this instance.
pub fn files() -> &'static Files {
    FILES.with(|files| *files)
}

/// The page's clock shows this, in milliseconds.
pub fn set_now(now_ms: f64) {
    NOW_MS.set(now_ms);
}

fn now() -> Duration {
    Duration::try_from_secs_f64(NOW_MS.get() / 1e3).unwrap_or_default()
}

/// Gives messages to the language server; answers what it says to them.
///
/// # Errors
/// A message is none.
pub fn serve(messages: Vec<Value>) -> Result<Value, String> {
    let mut queue = VecDeque::new();
    for message in messages {
        let message: Message =
            serde_json::from_value(message).map_err(|error| error.to_string())?;
        queue.push_back(Incoming::Message(message));
    }
    let mut output = Vec::new();
    let taken = SERVER.with_borrow_mut(|server| server.take(queue, &mut output));
    taken.map_err(|error| error.to_string())?;
    let mut answers = Vec::new();
    let mut rest = output.as_slice();
    while let Ok(Some(message)) = Message::read(&mut rest) {
        answers.push(serde_json::to_value(message).map_err(|error| error.to_string())?);
    }
    Ok(json!({ "messages": answers }))
}

/// A set of files, and the blob of its mission where nothing is wrong.
type Compiled = (Checked, Option<Verified<Vec<u8>>>);

/// Compiles the mission in a file for the host board.
///
/// # Errors
/// The file cannot be read, or there is nothing to run.
pub fn compiled(path: &str) -> Result<Compiled, String> {
    let mut checked = lang::load_from(path, files()).map_err(|error| error.to_string())?;
    checked.require_machine();
    let Some(schedule) = checked.lay_out(Limit::pieces(SEARCH_PIECES)) else {
        return Ok((checked, None));
    };
    if (checked.model.as_ref()).is_none_or(|model| model.machine.is_none()) {
        return Ok((checked, None));
    }
    let board = Some(&boards::HOST);
    let blob = fit::compile_to_fit(&mut checked, &schedule, board, NameTable::Kept);
    let blob = blob.map_err(|error| error.to_string())?;
    Ok((checked, blob))
}

/// The mission of a file, or what is wrong with it.
///
/// # Errors
/// See [`compiled`]; or the file has errors.
pub fn mission(path: &str) -> Result<Verified<Vec<u8>>, String> {
    let (checked, blob) = compiled(path)?;
    blob.ok_or_else(|| checked.render(false))
}

/// What is said of a mission when it is built.
#[derive(Serialize)]
struct Built {
    bytes: usize,
    hash: String,
}

/// Builds a mission; answers its size and hash, and all that is to be said about it.
///
/// # Errors
/// See [`compiled`].
pub fn build(path: &str) -> Result<Value, String> {
    let (checked, blob) = compiled(path)?;
    let built = blob.map(|blob| Built {
        hash: esm_toolkit::mission_hash::hash_text(blob.hash()),
        bytes: blob.into_bytes().len(),
    });
    Ok(json!({ "built": built, "diagnostics": diagnostics(&checked) }))
}

/// All diagnostics of a set of files, as `esm check --json` has them.
fn diagnostics(checked: &Checked) -> Vec<Value> {
    let lines = checked.json_lines();
    (lines.lines())
        .filter_map(|line| serde_json::from_str(line).ok())
        .collect()
}

/// The diagram of a file, with the places of its parts; none where there are errors.
///
/// # Errors
/// The file cannot be read.
pub fn draw(
    path: &str,
    depth: Option<u32>,
    otherwise: BTreeSet<String>,
    data: bool,
) -> Result<Value, String> {
    let checked = lang::load_from(path, files()).map_err(|error| error.to_string())?;
    let Some(model) = &checked.model else {
        return Ok(json!({ "svg": null }));
    };
    let options = Options {
        depth,
        otherwise,
        data,
        parts: true,
        ..Options::default()
    };
    let paths: Vec<&str> = model.files.iter().map(|file| file.path.as_str()).collect();
    match diagram::draw(model, &options) {
        Ok(scene) => Ok(json!({ "svg": scene.to_svg(), "files": paths })),
        Err(error) => Ok(json!({ "svg": null, "reason": error.to_string() })),
    }
}
