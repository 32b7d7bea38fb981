//! The calls of the page.

use std::collections::{BTreeMap, BTreeSet};

use serde::Deserialize;
use serde_json::{Value, json};

use crate::{desk, drive, live, looked, recorded};

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
        /// Superstates that show their inside otherwise than their level says.
        #[serde(default)]
        otherwise: BTreeSet<String>,
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
    /// Why the transitions from one state to another were not taken.
    Missing { t_us: u64, from: String, to: String },
    /// The values of a term of a guard over time.
    Term(looked::Term),
    /// Which numbers on nets there are.
    Curves,
    /// One of them over time.
    Curve {
        name: String,
        #[serde(default)]
        from_us: u64,
    },
    /// The slots of the mission of a time.
    Slots { t_us: u64 },
    /// A recording, whose bytes come with the request.
    Record,
    /// What has come of a robot that is connected: bytes come with the request, and the robot has
    /// made so many macro steps of its mission. Answers what is new.
    News { steps: Option<u64> },
    /// The same, for questions that come later.
    Hear { steps: Option<u64> },
}

/// Carries a request out. The answer is `{"ok": …}` or `{"error": "…"}`. Behind the request and a
/// zero byte, which is in no JSON, bytes may come with it.
pub fn carry_out(request: &[u8]) -> Vec<u8> {
    let end = request.iter().position(|byte| *byte == 0);
    let (text, bytes) = request.split_at(end.unwrap_or(request.len()));
    let bytes = bytes.get(1..).unwrap_or_default();
    let result = match serde_json::from_slice::<Request>(text) {
        Ok(request) => {
            desk::set_now(request.now_ms);
            call(request.call, bytes)
        }
        Err(error) => Err(format!("the request cannot be read: {error}")),
    };
    let answer = match result {
        Ok(value) => json!({ "ok": value }),
        Err(error) => json!({ "error": error }),
    };
    answer.to_string().into_bytes()
}

fn call(call: Call, bytes: &[u8]) -> Result<Value, String> {
    match call {
        Call::Files { files } => {
            desk::files().replace(files);
            Ok(Value::Null)
        }
        Call::Serve { messages } => desk::serve(messages),
        Call::Draw {
            path,
            depth,
            otherwise,
            data,
        } => desk::draw(&path, depth, otherwise, data),
        Call::Build { path } => desk::build(&path),
        Call::World { text } => drive::world(&text),
        Call::Start(plan) => drive::start(plan),
        Call::GoOn { to_us } => drive::go_on(to_us),
        Call::Choices { t_us } => {
            live::look(Some(t_us))?;
            looked::choices(t_us)
        }
        Call::Missing { t_us, from, to } => {
            live::look(None)?;
            looked::missing(t_us, &from, &to)
        }
        Call::Term(term) => {
            live::look(None)?;
            looked::term(&term)
        }
        Call::Curves => {
            live::look(None)?;
            looked::curves()
        }
        Call::Curve { name, from_us } => {
            live::look(None)?;
            looked::curve(&name, from_us)
        }
        Call::Slots { t_us } => {
            live::look(None)?;
            looked::slots(t_us)
        }
        Call::Record => recorded::record(bytes),
        Call::News { steps } => live::news(bytes, steps),
        Call::Hear { steps } => {
            live::hear(bytes, steps);
            Ok(Value::Null)
        }
    }
}
