//! The calls of the page.

use std::collections::BTreeMap;

use serde::Deserialize;
use serde_json::{Value, json};

use crate::{desk, drive};

/// A request.
#[derive(Deserialize)]
struct Request {
    /// What the page's clock shows, in milliseconds.
    #[serde(default)]
    now_ms: f64,
    #[serde(flatten)]
    call: Call,
}

/// What is asked for.
#[derive(Deserialize)]
#[serde(tag = "call", rename_all = "snake_case")]
enum Call {
    /// These are the page's files.
    Files { files: BTreeMap<String, String> },
    /// Messages for the language server.
    Serve { messages: Vec<Value> },
    /// The diagram of a file.
    Draw {
        path: String,
        #[serde(default)]
        depth: Option<u32>,
        #[serde(default)]
        data: bool,
    },
    /// The size of a mission's blob, and what is wrong with the mission.
    Build { path: String },
    /// A world as it is drawn.
    World { text: String },
    /// A run.
    Start(drive::Plan),
    /// The run goes on.
    GoOn { to_us: u64 },
    /// What the machine had to choose from.
    Choices { t_us: u64 },
}

/// Carries a request out. The answer is `{"ok": …}` or `{"error": "…"}`.
pub fn carry_out(request: &[u8]) -> Vec<u8> {
    let result = match serde_json::from_slice::<Request>(request) {
        Ok(request) => {
            desk::set_now(request.now_ms);
            call(request.call)
        }
        Err(error) => Err(format!("the request cannot be read: {error}")),
    };
    let answer = match result {
        Ok(value) => json!({ "ok": value }),
        Err(error) => json!({ "error": error }),
    };
    answer.to_string().into_bytes()
}

fn call(call: Call) -> Result<Value, String> {
    match call {
        Call::Files { files } => {
            desk::files().replace(files);
            Ok(Value::Null)
        }
        Call::Serve { messages } => desk::serve(messages),
        Call::Draw { path, depth, data } => desk::draw(&path, depth, data),
        Call::Build { path } => desk::build(&path),
        Call::World { text } => drive::world(&text),
        Call::Start(plan) => drive::start(plan),
        Call::GoOn { to_us } => drive::go_on(to_us),
        Call::Choices { t_us } => drive::choices(t_us),
    }
}
