//! The language server from outside: an editor's side of the protocol, spoken with the command.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::PathBuf;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{self, Receiver};
use std::time::Duration;

use esm_tests::command::{esm_binary, root};
use esm_tests::guesses::{GUESSES, MISSION as GUESSED};
use esm_tests::random::Random;
use esm_tests::subject;
use serde_json::{Value, json};

/// How long an answer may take.
const PATIENCE: Duration = Duration::from_secs(60);

const TASKS: &str = "// Goes ahead.
task Cruise slot 2 wcet 1 ms exclusive motion {
    in data ranges: Ranges;
    out data twist: Twist;
    out flag near;
    in flag left;
    param speed: f32 = 0.5 min 0.0 max 1.0;
}

task Sonar slot 2 {
    out data ranges: Ranges;
}

task Motor slot 2 {
    in data twist: Twist within 60 ms;
}
";

const MISSION: &str = "use \"tasks.esm\";

interpreter slot 1;
slot 1 period 10 ms duration 1 ms;
slot 2 rate 100 Hz duration 2 ms;

container Escape {
    in event Halt;
    out event Done;
    in flag left;
    in data ranges: Ranges;
    out data twist: Twist;

    region steps {
        task Back: Cruise with { speed = 0.25 };
        state Wait timeout 1500 ms;         // for 1.5 s

        initial -> Back;
        Back -> Wait [.near and ^left] / send Done;
        Wait -> Back on Halt / set .left;
    }

    path ranges -> Back.ranges;
    path Back.twist -> twist;
}

machine Rover {
    event Halt;

    region motion {
        task Ahead: Cruise;
        super Away: Escape;

        initial -> Ahead;
        Ahead -> Away [.near] / set .left, send Halt;
        Away -> Ahead on Done;
        Away -> Away on Halt;
    }

    region parts {
        task Listen: Sonar;
        initial -> Listen;
        Listen -> Listen on *;
    }

    region wheels {
        task Drive: Motor;
        initial -> Drive;
        Drive -> Drive on *;
    }

    path Listen.ranges -> Ahead.ranges, Away.ranges;
    path Ahead.twist, Away.twist -> Drive.twist;
}
";

/// The mission with its event declared, so that nothing is wrong with it.
fn mission() -> String {
    MISSION.replace(
        "event Halt;\n\n    region motion",
        "event Halt, Done;\n\n    region motion",
    )
}

/// An editor with a server and a folder.
struct Editor {
    server: Child,
    input: Option<ChildStdin>,
    output: Receiver<Value>,
    folder: tempfile::TempDir,
    last_id: i32,
    /// What is shown of each file, by its name.
    shown: BTreeMap<String, Vec<Value>>,
}

impl Editor {
    /// Starts a server in a folder with some files.
    fn new(files: &[(&str, &str)]) -> Self {
        Self::with_encodings(files, json!(null))
    }

    fn with_encodings(files: &[(&str, &str)], encodings: Value) -> Self {
        let mut editor = Self::raw(files);
        let folder = editor.uri("");
        let answer = editor.request(
            "initialize",
            json!({
                "processId": null,
                "rootUri": folder,
                "capabilities": { "general": { "positionEncodings": encodings } },
            }),
        );
        assert!(answer["capabilities"]["hoverProvider"].as_bool().unwrap());
        editor.notify("initialized", json!({}));
        editor
    }

    /// Starts a server and says nothing to it.
    fn raw(files: &[(&str, &str)]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        for (name, text) in files {
            std::fs::write(folder.path().join(name), text).unwrap();
        }
        let mut server = Command::new(esm_binary())
            .arg("lsp")
            .current_dir(root())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let input = server.stdin.take();
        let mut stream = BufReader::new(server.stdout.take().unwrap());
        let (sender, output) = mpsc::channel();
        std::thread::spawn(move || {
            loop {
                let mut length = 0;
                loop {
                    let mut line = String::new();
                    if stream.read_line(&mut line).unwrap_or(0) == 0 {
                        return;
                    }
                    match line.trim().strip_prefix("Content-Length: ") {
                        Some(digits) => length = digits.parse().unwrap(),
                        None if line.trim().is_empty() => break,
                        None => {}
                    }
                }
                let mut body = vec![0; length];
                stream.read_exact(&mut body).unwrap();
                if sender.send(serde_json::from_slice(&body).unwrap()).is_err() {
                    return;
                }
            }
        });
        Editor {
            server,
            input,
            output,
            folder,
            last_id: 0,
            shown: BTreeMap::new(),
        }
    }

    fn uri(&self, name: &str) -> String {
        let folder = self.folder.path().canonicalize().unwrap();
        format!("file://{}/{name}", folder.display())
            .trim_end_matches('/')
            .to_owned()
    }

    fn send_bytes(&mut self, bytes: &[u8]) {
        let input = self.input.as_mut().unwrap();
        input.write_all(bytes).unwrap();
        input.flush().unwrap();
    }

    fn send(&mut self, message: &Value) {
        self.send_bytes(&bytes_of(message));
    }

    fn notify(&mut self, method: &str, params: Value) {
        self.send(&json!({ "jsonrpc": "2.0", "method": method, "params": params }));
    }

    /// The next message from the server; what is to be shown is taken down on the way.
    #[track_caller]
    fn receive(&mut self) -> Value {
        let message = self
            .output
            .recv_timeout(PATIENCE)
            .expect("the server says something");
        if message["method"] == "textDocument/publishDiagnostics" {
            let uri = message["params"]["uri"].as_str().unwrap();
            let name = uri.rsplit('/').next().unwrap().to_owned();
            let list = message["params"]["diagnostics"].as_array().unwrap().clone();
            self.shown.insert(name, list);
        }
        message
    }

    /// The answer to a request, result and error alike.
    #[track_caller]
    fn answer(&mut self, method: &str, params: Value) -> Value {
        self.last_id += 1;
        let id = self.last_id;
        self.send(&json!({ "jsonrpc": "2.0", "id": id, "method": method, "params": params }));
        loop {
            let message = self.receive();
            if message["id"] == id {
                return message;
            }
        }
    }

    #[track_caller]
    fn request(&mut self, method: &str, params: Value) -> Value {
        let answer = self.answer(method, params);
        assert!(answer["error"].is_null(), "{method}: {answer}");
        answer["result"].clone()
    }

    #[track_caller]
    fn refusal(&mut self, method: &str, params: Value) -> (i64, String) {
        let answer = self.answer(method, params);
        let error = &answer["error"];
        let code = error["code"].as_i64();
        (
            code.unwrap_or_else(|| panic!("{method} is not refused: {answer}")),
            error["message"].as_str().unwrap().to_owned(),
        )
    }

    fn open(&mut self, name: &str, text: &str) {
        let uri = self.uri(name);
        self.notify(
            "textDocument/didOpen",
            json!({ "textDocument": { "uri": uri, "languageId": "esm", "version": 1, "text": text } }),
        );
    }

    fn change(&mut self, name: &str, changes: Value) {
        let note = self.changed(name, changes);
        self.send(&note);
    }

    /// The message that tells of changes.
    fn changed(&self, name: &str, changes: Value) -> Value {
        let uri = self.uri(name);
        let params =
            json!({ "textDocument": { "uri": uri, "version": 2 }, "contentChanges": changes });
        json!({ "jsonrpc": "2.0", "method": "textDocument/didChange", "params": params })
    }

    /// What is shown once the server has nothing more to do: codes and lines from 1, by file.
    #[track_caller]
    fn diagnostics(&mut self) -> Vec<String> {
        // What is shown follows what was asked before; a second question follows what is shown.
        for _ in 0..2 {
            self.answer("esm/nothing", json!({}));
        }
        let mut found = Vec::new();
        for (file, list) in &self.shown {
            for it in list {
                let line = it["range"]["start"]["line"].as_i64().unwrap() + 1;
                found.push(format!("{file}:{line} {}", it["code"].as_str().unwrap()));
            }
        }
        found
    }

    /// A place in a file: behind the first `|` of a pattern that stands in its text without it.
    fn at(&self, name: &str, text: &str, pattern: &str) -> Value {
        let before = pattern.find('|').unwrap();
        let start = text
            .find(&pattern.replacen('|', "", 1))
            .unwrap_or_else(|| panic!("no {pattern}"));
        let lines = &text[..start + before];
        let line = lines.matches('\n').count();
        let character = lines.len() - lines.rfind('\n').map_or(0, |at| at + 1);
        json!({
            "textDocument": { "uri": self.uri(name) },
            "position": { "line": line, "character": character },
        })
    }

    fn labels(&mut self, name: &str, text: &str, pattern: &str) -> Vec<String> {
        let at = self.at(name, text, pattern);
        let items = self.request("textDocument/completion", at);
        let items = items.as_array().unwrap().iter();
        items
            .map(|item| item["label"].as_str().unwrap().to_owned())
            .collect()
    }

    /// The quick fixes of a whole file.
    fn fixes(&mut self, name: &str) -> Vec<Value> {
        let params = json!({
            "textDocument": { "uri": self.uri(name) },
            "range": { "start": { "line": 0, "character": 0 }, "end": { "line": 100_000, "character": 0 } },
            "context": { "diagnostics": [] },
        });
        let actions = self.request("textDocument/codeAction", params);
        actions.as_array().unwrap().clone()
    }

    /// The text of a file with a fix applied that changes no other one.
    fn mended(&self, name: &str, text: &str, action: &Value) -> String {
        assert_eq!(action["kind"], "quickfix");
        let changes = action["edit"]["changes"].as_object().unwrap();
        let uris: Vec<&String> = changes.keys().collect();
        assert_eq!(uris, [&self.uri(name)], "{action}");
        edited(text, &changes[uris[0]])
    }

    /// What is shown of a file, as codes and messages.
    fn told(&mut self, name: &str) -> Vec<(String, String)> {
        self.diagnostics();
        let shown = self.shown.get(name).into_iter().flatten();
        let told = |it: &Value| {
            let text = |key: &str| it[key].as_str().unwrap().to_owned();
            (text("code"), text("message"))
        };
        shown.map(told).collect()
    }

    /// Ends the conversation, and gives the exit status.
    fn end(mut self) -> Option<i32> {
        self.request("shutdown", json!(null));
        assert_eq!(self.refusal("textDocument/hover", json!({})).0, -32600);
        self.notify("exit", json!(null));
        self.server.wait().unwrap().code()
    }
}

impl Drop for Editor {
    fn drop(&mut self) {
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

/// A message as it is sent.
fn bytes_of(message: &Value) -> Vec<u8> {
    let text = message.to_string();
    format!("Content-Length: {}\r\n\r\n{text}", text.len()).into_bytes()
}

/// Text of a range, both as the protocol counts; the texts here have one byte a character.
fn range_text<'t>(text: &'t str, range: &Value) -> &'t str {
    let offset = |place: &Value| {
        let line = place["line"].as_u64().unwrap() as usize;
        let lines: usize = text.split_inclusive('\n').take(line).map(str::len).sum();
        lines + place["character"].as_u64().unwrap() as usize
    };
    &text[offset(&range["start"])..offset(&range["end"])]
}

/// What tells one shown diagnostic from others: its code and its message without the hint.
fn kind_of(shown: &Value) -> (String, String) {
    let text = |key: &str| shown[key].as_str().unwrap().to_owned();
    let message = text("message");
    let first = message.lines().next().unwrap_or("");
    (text("code"), first.to_owned())
}

/// The text with edits applied, last one first.
fn edited(text: &str, edits: &Value) -> String {
    let mut edits = edits.as_array().unwrap().clone();
    edits.sort_by_key(|edit| {
        let start = &edit["range"]["start"];
        (start["line"].as_u64(), start["character"].as_u64())
    });
    let mut text = text.to_owned();
    for edit in edits.iter().rev() {
        let part = range_text(&text, &edit["range"]);
        let start = part.as_ptr() as usize - text.as_ptr() as usize;
        let end = start + part.len();
        text.replace_range(start..end, edit["newText"].as_str().unwrap());
    }
    text
}

#[test]
fn mistakes_are_shown_as_they_are_made_and_cleared_as_they_are_mended() {
    let mut editor = Editor::new(&[("tasks.esm", TASKS), ("mission.esm", &mission())]);
    editor.open("mission.esm", MISSION);
    assert_eq!(editor.diagnostics(), ["mission.esm:36 E002"]);
    let shown = editor.shown["mission.esm"][0].clone();
    assert_eq!(shown["severity"], 1);
    assert_eq!(range_text(MISSION, &shown["range"]), "Done");
    assert!(
        shown["message"].as_str().unwrap().contains("\ndeclare it"),
        "{shown}"
    );

    // One key stroke at a time, in the place of a change.
    for (column, text) in [
        (14, ","),
        (15, " "),
        (16, "D"),
        (17, "o"),
        (18, "n"),
        (19, "e"),
    ] {
        let place = json!({ "line": 27, "character": column });
        editor.change(
            "mission.esm",
            json!([{ "range": { "start": place, "end": place }, "text": text }]),
        );
    }
    assert_eq!(editor.diagnostics(), [] as [&str; 0]);

    // What is open counts, and not what is on disk; a mistake in one file is shown in the other.
    editor.open("tasks.esm", &TASKS.replace("out flag near", "out flag far"));
    assert_eq!(
        editor.diagnostics(),
        ["mission.esm:19 E002", "mission.esm:35 E002"]
    );
    editor.change(
        "tasks.esm",
        json!([{ "text": format!("{TASKS}task Sonar slot 2 {{}}") }]),
    );
    assert_eq!(editor.diagnostics(), ["tasks.esm:17 E003"]);
    let related = &editor.shown["tasks.esm"][0]["relatedInformation"][0];
    assert_eq!(related["message"], "first defined here");
    assert_eq!(related["location"]["range"]["start"]["line"], 9);
    let uri = editor.uri("tasks.esm");
    editor.notify(
        "textDocument/didClose",
        json!({ "textDocument": { "uri": uri } }),
    );
    assert_eq!(editor.diagnostics(), [] as [&str; 0]);
    assert_eq!(editor.end(), Some(0));
}

#[test]
fn names_lead_to_their_declarations_and_uses() {
    let mission = mission();
    let mut editor = Editor::new(&[("tasks.esm", TASKS), ("mission.esm", &mission)]);
    editor.open("mission.esm", &mission);
    for (pattern, file, line) in [
        ("task Back: Cru|ise", "tasks.esm", 1),
        ("super Away: |Escape", "mission.esm", 6),
        ("|Back -> Wait", "mission.esm", 14),
        ("[.near| and", "tasks.esm", 4),
        ("^|left]", "mission.esm", 9),
        ("send |Done", "mission.esm", 8),
        ("on |Halt / set", "mission.esm", 7),
        ("/ set .|left;", "tasks.esm", 5),
        ("{ |speed", "tasks.esm", 6),
        ("-> Back.|ranges", "tasks.esm", 2),
        ("Away.|twist", "mission.esm", 11),
        ("interpreter slot |1", "mission.esm", 3),
        ("use \"tasks|.esm", "tasks.esm", 0),
    ] {
        let at = editor.at("mission.esm", &mission, pattern);
        let found = editor.request("textDocument/definition", at);
        assert_eq!(found["uri"], editor.uri(file), "{pattern}");
        assert_eq!(found["range"]["start"]["line"], line, "{pattern}");
    }
    let at = editor.at("mission.esm", &mission, "dura|tion 1 ms");
    assert!(editor.request("textDocument/definition", at).is_null());

    for (pattern, count) in [
        ("send |Halt", 5),
        ("task |Back", 6),
        ("Listen.|ranges", 2),
        ("[.|near]", 3),
        ("slot |2 rate", 4),
        ("data ranges: |Ranges", 3),
    ] {
        let mut at = editor.at("mission.esm", &mission, pattern);
        at["context"] = json!({ "includeDeclaration": true });
        let found = editor.request("textDocument/references", at.clone());
        assert_eq!(found.as_array().unwrap().len(), count, "{pattern}: {found}");
        at["context"] = json!({ "includeDeclaration": false });
        let found = editor.request("textDocument/references", at);
        assert_eq!(
            found.as_array().unwrap().len(),
            count - 1,
            "{pattern}: {found}"
        );
    }
    // From a file that others use, also where these are not open.
    let uri = editor.uri("mission.esm");
    editor.notify(
        "textDocument/didClose",
        json!({ "textDocument": { "uri": uri } }),
    );
    editor.open("tasks.esm", TASKS);
    let at = editor.at("tasks.esm", TASKS, "task |Cruise");
    let found = editor.request("textDocument/references", at);
    assert_eq!(found.as_array().unwrap().len(), 3, "{found}");
    assert_eq!(editor.end(), Some(0));
}

#[test]
fn hovering_tells_what_a_name_is() {
    let mission = mission();
    let mut editor = Editor::new(&[("tasks.esm", TASKS)]);
    editor.open("mission.esm", &mission);
    let cases: [(&str, &[&str]); 6] = [
        (
            "task Back: |Cruise",
            &[
                "Goes ahead.",
                "out flag near;",
                "param speed",
                "worst case execution time 1 ms",
            ],
        ),
        (
            "-> |Wait [",
            &[
                "state Wait timeout 1500 ms;",
                "for 1.5 s",
                "timeout after 1500 ms",
                "Ways out",
                "Wait -> Back on Halt / set .left;",
                "Ways in",
                "Back -> Wait [.near and ^left]",
            ],
        ),
        (
            "send |Halt",
            &[
                "event Halt, Done;",
                "Sent by",
                "Ahead -> Away [.near]",
                "Received by",
                "Away -> Away on Halt;",
                "Wait -> Back on Halt",
            ],
        ),
        (
            "|Away -> Ahead",
            &[
                "super Away: Escape;",
                "container Escape {",
                "in flag left;",
                "    …\n}",
            ],
        ),
        (
            "slot |2 rate",
            &[
                "slot 2 rate 100 Hz duration 2 ms;",
                "every 10 ms (100 Hz), 2 ms long: 20.0 % of the time",
            ],
        ),
        ("[.|near]", &["out flag near;"]),
    ];
    for (pattern, expected) in cases {
        let at = editor.at("mission.esm", &mission, pattern);
        let found = editor.request("textDocument/hover", at);
        let text = found["contents"]["value"].as_str().unwrap();
        for part in expected {
            assert!(text.contains(part), "{pattern}: no {part:?} in\n{text}");
        }
    }
    let at = editor.at("mission.esm", &mission, "|interpreter");
    assert!(editor.request("textDocument/hover", at).is_null());
    assert_eq!(editor.end(), Some(0));
}

#[test]
fn what_can_stand_at_a_place_is_proposed() {
    let mission = mission();
    let mut editor = Editor::new(&[("tasks.esm", TASKS)]);
    editor.open("mission.esm", &mission);
    // What is written in place of a pattern, and what must and must not be proposed at its end.
    let cases: [(&str, &str, &[&str], &[&str]); 17] = [
        (
            "interpreter slot 1;",
            "",
            &["container", "machine", "use"],
            &["region"],
        ),
        (
            "Away -> Ahead on Done;",
            "Away -> ",
            &["Ahead", "final"],
            &["Back", "Rover"],
        ),
        (
            "Away -> Ahead on Done;",
            "Away -> Ahead on D",
            &["pulse", "*", "Halt", "Done"],
            &["Ahead"],
        ),
        (
            "Away -> Ahead on Done;",
            "Away -> Ahead ",
            &["on"],
            &["Halt"],
        ),
        (
            "Back -> Wait [.near",
            "Back -> Wait [",
            &[".near", "^left", "exit", "not"],
            &[".left"],
        ),
        (
            "Back -> Wait [.near",
            "Back -> Wait [.",
            &["near"],
            &["left", "exit"],
        ),
        ("[.near and ^left]", "[.near and ^", &["left"], &["near"]),
        ("[.near and ^left]", "[.near ", &["and", "or"], &["send"]),
        (
            "/ set .left, send Halt;",
            "/ ",
            &["send", "set", "clear"],
            &["and"],
        ),
        ("/ set .left, send Halt;", "/ set .", &["left"], &["near"]),
        (
            "/ set .left, send Halt;",
            "/ send ",
            &["Halt", "Done"],
            &["Ahead"],
        ),
        (
            "task Back: Cruise with { speed = 0.25 };",
            "task Back: ",
            &["Cruise", "Sonar"],
            &["Escape"],
        ),
        (
            "task Back: Cruise with { speed = 0.25 };",
            "task Back: Cruise with { ",
            &["speed"],
            &["near"],
        ),
        (
            "super Away: Escape;",
            "super Away: ",
            &["Escape"],
            &["Rover", "Cruise"],
        ),
        (
            "path ranges -> Back.ranges;",
            "path ",
            &["ranges", "Back.twist"],
            &["Wait"],
        ),
        (
            "path ranges -> Back.ranges;",
            "path ranges -> Back.",
            &["ranges", "twist"],
            &["near"],
        ),
        (
            "in data ranges: Ranges;",
            "in ",
            &["data", "flag", "event"],
            &["region"],
        ),
    ];
    for (pattern, written, wanted, unwanted) in cases {
        let text = mission.replacen(pattern, written, 1);
        let end = mission.find(pattern).unwrap() + written.len();
        let marked = format!("{}|{}", &text[..end], &text[end..]);
        editor.change("mission.esm", json!([{ "text": text }]));
        let labels = editor.labels("mission.esm", &text, &marked);
        for label in wanted {
            assert!(
                labels.iter().any(|it| it == label),
                "{written:?}: no {label} in {labels:?}"
            );
        }
        for label in unwanted {
            assert!(
                !labels.iter().any(|it| it == label),
                "{written:?}: {label} in {labels:?}"
            );
        }
    }
    let text = "// in a comment ";
    editor.change("mission.esm", json!([{ "text": text }]));
    assert_eq!(
        editor.labels("mission.esm", text, "// in a comment |"),
        [] as [&str; 0]
    );
    assert_eq!(editor.end(), Some(0));
}

#[test]
fn what_describes_a_declaration_is_shown_with_it() {
    const TEXT: &str = "/// Drives ahead.
/// Stops where something is near.
task Cruise slot 1 endless {
    /// Where it looks.
    in data ranges: Ranges optional within 50 ms;
    /// Something is near.
    out flag near; // at last
    /// How fast, in metres a second.
    param speed: f32 = 0.5;
}
// Not about it.
/// What the robot does.
machine M {
    /// Somebody knocks.
    event Knock;
    region r {
        /// Where all begins.
        task Ahead: Cruise with { speed = 0.2 };
        initial -> Ahead; Ahead -> Ahead on Knock [.near];
    }
}
";
    let mut editor = Editor::new(&[]);
    editor.open("mission.esm", TEXT);
    let cases: [(&str, &str); 8] = [
        (
            "task |Cruise",
            "```\n\nDrives ahead.\nStops where something is near.",
        ),
        ("in data |ranges", "```\n\nWhere it looks."),
        ("[.|near]", "```\n\nSomething is near."),
        ("with { |speed", "```\n\nHow fast, in metres a second."),
        ("on |Knock", "```\n\nSomebody knocks."),
        ("machine |M", "```\n\nWhat the robot does."),
        ("task |Ahead", "```\n\nWhere all begins."),
        // And of what it is made.
        (
            "task |Ahead",
            "```\n\nDrives ahead.\nStops where something is near.",
        ),
    ];
    for (pattern, expected) in cases {
        let at = editor.at("mission.esm", TEXT, pattern);
        let found = editor.request("textDocument/hover", at);
        let text = found["contents"]["value"].as_str().unwrap();
        assert!(
            text.contains(expected),
            "{pattern}: no {expected:?} in\n{text}"
        );
        assert!(
            !text.contains("Not about it") && !text.contains("\nat last"),
            "{pattern}:\n{text}"
        );
    }
    let cases: [(&str, &str, &str); 5] = [
        (
            "task Ahead: |Cruise",
            "Cruise",
            "Drives ahead.\nStops where something is near.",
        ),
        ("with { |speed", "speed", "How fast, in metres a second."),
        ("[.|near]", "near", "Something is near."),
        ("on |Knock", "Knock", "Somebody knocks."),
        ("initial -> |Ahead", "Ahead", "Where all begins."),
    ];
    for (pattern, label, expected) in cases {
        let at = editor.at("mission.esm", TEXT, pattern);
        let items = editor.request("textDocument/completion", at);
        let mut items = items.as_array().unwrap().iter();
        let item = items.find(|item| item["label"] == label).unwrap();
        assert_eq!(item["documentation"]["value"], expected, "{pattern}");
    }
    // Attributes that are given are not proposed again, and containers ask for nothing.
    let cases: [(&str, &[&str]); 5] = [
        ("task T { in data a: A |; }", &["optional", "within"]),
        ("task T { in data a: A within 5 ms |; }", &["optional"]),
        ("task T { out data a: A |; }", &["optional"]),
        (
            "container C { in data a: A |; region r { initial -> final; } }",
            &["optional"],
        ),
        (
            "task T |{ }",
            &["slot", "wcet", "exclusive", "count", "endless"],
        ),
    ];
    for (marked, expected) in cases {
        let text = marked.replacen('|', "", 1);
        editor.change("mission.esm", json!([{ "text": text }]));
        assert_eq!(
            editor.labels("mission.esm", &text, marked),
            expected,
            "{marked}"
        );
    }
    assert_eq!(editor.end(), Some(0));
}

/// The model of a set of files, as text, with one name written in place of another.
fn meaning(tasks: &str, mission: &str, from: &str, to: &str) -> String {
    let checked = host_tools::lang::load_texts(&[("mission.esm", mission), ("tasks.esm", tasks)]);
    let mut model = checked
        .model
        .unwrap_or_else(|| panic!("it has errors:\n{mission}\n{tasks}"));
    model.files.clear();
    let text = format!("{model:#?}");
    // Where things stand is no part of what they mean.
    let mut kept: Vec<String> = Vec::new();
    let mut skipped = 0;
    for line in text.lines() {
        if line.trim_start().contains("Span {") {
            skipped = 4;
        } else if skipped == 0 {
            kept.push(line.replace(&format!("\"{from}\""), &format!("\"{to}\"")));
        } else {
            skipped -= 1;
        }
    }
    kept.join("\n")
}

#[test]
fn links_and_frames_are_completed_renamed_and_outlined() {
    const RADIO: &str = "interpreter slot 1;
slot 1 period 10 ms duration 1 ms;
slot 2 period 10 ms duration 1 ms;
link radio rate 9600 bps;
frame alarm 1 out on radio flags lost, low payload 1 bytes period 100 ms;
frame pose 2 in on radio: Pose payload 12 bytes period 100 ms;
machine M {
    region s {
        task Send: radio.transmit slot 2;
        initial -> Send / set .lost;
    }
    region r {
        task Take: radio.receive slot 2;
        state Late;
        initial -> Take;
        Take -> Late [.pose_delayed or .errors];
        Late -> Take [timeout];
    }
}
";
    let mut editor = Editor::new(&[("radio.esm", RADIO)]);
    editor.open("radio.esm", RADIO);
    for (pattern, expected) in [
        ("link radio |rate", &["rate"][..]),
        ("frame alarm 1 |out", &["in", "out"]),
        ("out on |radio", &["radio"]),
        ("task Send: radio.|transmit", &["transmit", "receive"]),
        ("/ set .|lost", &["lost", "low"]),
        (
            "[.|pose_delayed",
            &["pose_available", "pose_delayed", "errors"],
        ),
    ] {
        assert_eq!(
            editor.labels("radio.esm", RADIO, pattern),
            expected,
            "{pattern}"
        );
    }
    for (pattern, old, new) in [
        ("frame |pose", "pose", "place"),
        ("[.|pose_delayed", "pose", "place"),
        ("link |radio", "radio", "line"),
        ("flags |lost", "lost", "gone"),
    ] {
        let mut at = editor.at("radio.esm", RADIO, pattern);
        at["newName"] = json!(new);
        let found = editor.request("textDocument/rename", at);
        let edits = &found["changes"][&editor.uri("radio.esm")];
        let changed = edited(RADIO, edits);
        assert_eq!(changed, RADIO.replace(old, new), "{pattern}");
    }
    let uri = json!({ "textDocument": { "uri": editor.uri("radio.esm") } });
    let symbols = editor.request("textDocument/documentSymbol", uri);
    let names: Vec<&str> = symbols
        .as_array()
        .unwrap()
        .iter()
        .map(|symbol| symbol["name"].as_str().unwrap())
        .collect();
    assert_eq!(names, ["slot 1", "slot 2", "radio", "alarm", "pose", "M"]);
    let hover = editor.at("radio.esm", RADIO, "[.|pose_delayed");
    let hover = editor.request("textDocument/hover", hover).to_string();
    assert!(hover.contains("frame pose 2 in on radio: Pose"), "{hover}");
}

#[test]
fn a_name_is_changed_everywhere_and_nothing_else_is() {
    let mission = mission();
    let mut editor = Editor::new(&[("tasks.esm", TASKS), ("mission.esm", &mission)]);
    editor.open("mission.esm", &mission);
    let blob = |tasks: &str, mission: &str| {
        // One text, so that it can be compiled like any other.
        let joined = mission.replace("use \"tasks.esm\";", tasks);
        subject::build(&joined).unwrap().blob.len()
    };
    for (pattern, old, new, files) in [
        ("super Away: |Escape", "Escape", "Getaway", 1),
        ("task |Back", "Back", "Tuck", 1),
        ("region |motion", "motion", "drives", 1),
        ("send |Halt", "Halt", "Stop", 1),
        ("send |Done", "Done", "Over", 1),
        ("^|left", "left", "lift", 1),
        ("path |ranges", "ranges", "sounds", 1),
        ("task Back: |Cruise", "Cruise", "Strays", 2),
        ("[.|near and", "near", "nigh", 2),
        ("{ |speed", "speed", "pace_", 2),
        ("data ranges: |Ranges", "Ranges", "Sounds", 2),
    ] {
        let mut at = editor.at("mission.esm", &mission, pattern);
        let prepared = editor.request("textDocument/prepareRename", at.clone());
        assert_eq!(prepared["placeholder"], old);
        at["newName"] = json!(new);
        let found = editor.request("textDocument/rename", at);
        let changes = found["changes"].as_object().unwrap();
        assert_eq!(changes.len(), files, "{pattern}: {found}");
        let apply = |name: &str, text: &str| {
            changes
                .get(&editor.uri(name))
                .map_or(text.to_owned(), |edits| edited(text, edits))
        };
        let (new_tasks, new_mission) = (apply("tasks.esm", TASKS), apply("mission.esm", &mission));
        assert_ne!(
            (new_tasks.as_str(), new_mission.as_str()),
            (TASKS, mission.as_str())
        );
        // Other things of the same name are told apart by their places: going back leads to the
        // same texts.
        assert_eq!(
            meaning(&new_tasks, &new_mission, new, old),
            meaning(TASKS, &mission, new, old),
            "{pattern}"
        );
        let difference = new.len().abs_diff(old.len());
        let sizes = (blob(&new_tasks, &new_mission), blob(TASKS, &mission));
        assert!(
            sizes.0.abs_diff(sizes.1) <= 8 * difference,
            "{pattern}: {sizes:?}"
        );
    }
    for (pattern, new, reason) in [
        ("super Away: |Escape", "machine", "reserved word"),
        ("super Away: |Escape", "1st", "no name"),
        ("super Away: |Escape", "a b", "no name"),
        ("super Away: |Escape", "", "no name"),
        ("task |Back", "Wait", "already the name"),
        ("send |Halt", "Done", "already the name"),
        ("task Back: |Cruise", "Sonar", "already the name"),
        ("data ranges: |Ranges", "Twist", "already the name"),
        ("slot |1 period", "three", "number"),
        ("|interpreter", "x", "no name here"),
    ] {
        let mut at = editor.at("mission.esm", &mission, pattern);
        at["newName"] = json!(new);
        let (_, message) = editor.refusal("textDocument/rename", at);
        assert!(message.contains(reason), "{pattern} to {new}: {message}");
    }
    // A name that leads elsewhere in a third file, which is not open.
    let third = "use \"tasks.esm\";\ntask Free slot 2 {}\n";
    std::fs::write(editor.folder.path().join("third.esm"), third).unwrap();
    let mut at = editor.at("mission.esm", &mission, "task Back: |Cruise");
    at["newName"] = json!("Free");
    let (_, message) = editor.refusal("textDocument/rename", at);
    assert!(message.contains("already the name"), "{message}");
    assert_eq!(editor.end(), Some(0));
}

#[test]
fn a_file_is_laid_out_and_outlined() {
    let mut editor = Editor::new(&[("tasks.esm", TASKS)]);
    let untidy = mission().replace("-> ", "  ->   ");
    editor.open("mission.esm", &untidy);
    let uri = editor.uri("mission.esm");
    let about = json!({ "textDocument": { "uri": uri }, "options": {} });
    let edits = editor.request("textDocument/formatting", about.clone());
    let tidy = edited(&untidy, &edits);
    let laid_out = host_tools::lang::format::format("mission.esm", mission().as_bytes()).unwrap();
    assert_eq!(tidy, laid_out);
    editor.change("mission.esm", json!([{ "text": tidy }]));
    assert_eq!(
        editor.request("textDocument/formatting", about.clone()),
        json!([])
    );

    let symbols = editor.request("textDocument/documentSymbol", about.clone());
    let names = |list: &Value| -> Vec<String> {
        let list = list.as_array().unwrap().iter();
        list.map(|it| it["name"].as_str().unwrap().to_owned())
            .collect()
    };
    assert_eq!(names(&symbols), ["slot 1", "slot 2", "Escape", "Rover"]);
    let rover = &symbols[3];
    assert_eq!(
        names(&rover["children"]),
        ["Halt", "Done", "motion", "parts", "wheels"]
    );
    assert_eq!(names(&rover["children"][2]["children"]), ["Ahead", "Away"]);
    assert!(range_text(&tidy, &rover["range"]).starts_with("machine Rover {"));
    assert!(range_text(&tidy, &rover["range"]).ends_with("Drive.twist;\n}"));

    let folds = editor.request("textDocument/foldingRange", about.clone());
    assert_eq!(folds.as_array().unwrap().len(), 6, "{folds}");

    editor.change("mission.esm", json!([{ "text": "queue" }]));
    assert!(editor.request("textDocument/formatting", about).is_null());
    assert_eq!(editor.end(), Some(0));
}

#[test]
fn places_are_counted_as_was_agreed() {
    let text = "/* ä😀 */ slot 1 period 1 ms duration 2 ms;";
    for (encodings, agreed, column) in [
        (json!(null), "utf-16", 10),
        (json!(["utf-32", "utf-8"]), "utf-32", 9),
        (json!(["utf-7", "utf-8"]), "utf-8", 13),
    ] {
        let mut editor = Editor::with_encodings(&[], encodings);
        editor.open("a.esm", text);
        assert_eq!(editor.diagnostics(), ["a.esm:1 E010"]);
        let range = &editor.shown["a.esm"][0]["range"];
        assert_eq!(range["start"]["character"], column, "{agreed}");
        let place = json!({ "line": 0, "character": column });
        editor.change(
            "a.esm",
            json!([{ "range": { "start": place, "end": place }, "text": "\n" }]),
        );
        assert_eq!(editor.diagnostics(), ["a.esm:2 E010"], "{agreed}");
        assert_eq!(editor.end(), Some(0));
    }
}

#[test]
fn what_makes_no_sense_is_refused_and_the_server_goes_on() {
    let mut editor = Editor::raw(&[]);
    assert_eq!(editor.refusal("textDocument/hover", json!({})).0, -32002);
    editor.request("initialize", json!({ "capabilities": {} }));
    assert_eq!(editor.refusal("initialize", json!({})).0, -32600);
    assert_eq!(
        editor.refusal("textDocument/everything", json!({})).0,
        -32601
    );
    for params in [
        json!(null),
        json!([]),
        json!({ "textDocument": 3 }),
        json!({ "textDocument": { "uri": "file:///nowhere" }, "position": { "line": -1, "character": 0 } }),
        json!({ "textDocument": { "uri": "file:///nowhere" }, "position": { "line": 0, "character": 0 } }),
    ] {
        assert_eq!(
            editor.refusal("textDocument/hover", params.clone()).0,
            -32602,
            "{params}"
        );
        editor.notify("textDocument/didOpen", params.clone());
        editor.notify("textDocument/didChange", params);
    }
    for garbage in [
        &b"Content-Length: 5\r\n\r\n{]}}}"[..],
        b"Content-Length: 99999999999999999999\r\n\r\n",
        b"\xFF\xFE\r\nnonsense\r\n\r\n",
        b"Content-Length: 2\r\n\r\n{}",
    ] {
        editor.send_bytes(garbage);
    }
    // A request that is taken back while the server is busy with what comes before.
    let uri = "untitled:Untitled-1";
    editor.notify(
        "textDocument/didOpen",
        json!({ "textDocument": { "uri": uri, "version": 1, "text": "use \"x.esm\"; slot 1 period 1 ms duration 2 ms; queue" } }),
    );
    editor.send(&json!({ "jsonrpc": "2.0", "id": "late", "method": "textDocument/documentSymbol", "params": { "textDocument": { "uri": uri } } }));
    editor.notify("$/cancelRequest", json!({ "id": "late" }));
    loop {
        let message = editor.receive();
        if message["id"] == "late" {
            let code = message["error"]["code"].as_i64();
            assert!(
                code == Some(-32800) || message["result"].is_array(),
                "{message}"
            );
            break;
        }
    }
    // What is no file is checked by itself.
    editor.diagnostics();
    let codes: Vec<&Value> = editor.shown[uri].iter().map(|it| &it["code"]).collect();
    assert_eq!(codes, ["E013", "E010", "E001"]);
    let huge = json!({ "line": u32::MAX, "character": u32::MAX });
    editor.notify(
        "textDocument/didChange",
        json!({ "textDocument": { "uri": uri, "version": 2 }, "contentChanges": [{ "range": { "start": huge, "end": huge }, "text": " 3;" }] }),
    );
    editor.diagnostics();
    assert_eq!(editor.shown[uri].len(), 2);
    assert_eq!(editor.end(), Some(0));

    // An editor that goes without a word.
    let mut editor = Editor::new(&[]);
    drop(editor.input.take());
    assert_eq!(editor.server.wait().unwrap().code(), Some(1));
}

#[test]
fn no_text_ends_the_server() {
    let missions: Vec<PathBuf> = ["patrol", "rover", "follow_wall"]
        .map(|name| root().join(format!("missions/{name}.esm")))
        .into();
    let mut editor = Editor::new(&[("tasks.esm", TASKS)]);
    editor.open("mission.esm", "");
    let mut random = Random::new(3);
    for round in 0..150 {
        let path = random.pick(&missions).unwrap();
        let mut text = std::fs::read_to_string(path).unwrap();
        for _ in 0..random.between(1, 3) {
            let (a, b) = (random.below(text.len()), random.below(text.len()));
            match random.below(4) {
                0 => text.truncate(a),
                1 => text.replace_range(a.min(b)..a.max(b), ""),
                2 => text.insert_str(
                    a,
                    ["{", "}", ";", "/*", "\"", "->", "\u{0}", "ä", "[", "."][random.below(10)],
                ),
                _ => text = format!("{}{}", &text[a..], &text[..b]),
            }
            if text.is_empty() {
                text.push(' ');
            }
        }
        editor.change("mission.esm", json!([{ "text": text }]));
        let lines = text.lines().count().max(1);
        for _ in 0..3 {
            let at = json!({
                "textDocument": { "uri": editor.uri("mission.esm") },
                "position": { "line": random.below(lines), "character": random.below(60) },
                "newName": "Other",
            });
            for method in [
                "completion",
                "hover",
                "definition",
                "references",
                "prepareRename",
                "rename",
                "documentHighlight",
            ] {
                editor.answer(&format!("textDocument/{method}"), at.clone());
            }
        }
        let about = json!({ "textDocument": { "uri": editor.uri("mission.esm") } });
        for method in ["formatting", "documentSymbol", "foldingRange"] {
            let answer = editor.answer(&format!("textDocument/{method}"), about.clone());
            assert!(answer["error"].is_null(), "round {round}: {answer}");
        }
    }
    assert_eq!(editor.end(), Some(0));
}

#[test]
fn requests_do_not_pile_up_behind_changes_of_a_long_text() {
    let mut long = mission();
    // So long that a check is slow, however the server is compiled.
    for index in 0..160_000 {
        long.push_str(&format!(
            "container Spare{index} {{ region r {{ state A; initial -> A; A -> final; }} }}\n"
        ));
    }
    let mut editor = Editor::new(&[("tasks.esm", TASKS)]);
    editor.open("mission.esm", &long);
    let at = editor.at("mission.esm", &long, "super Away: |Escape");
    // The first answer needs a check, which shows how long one takes.
    assert!(!editor.request("textDocument/hover", at.clone()).is_null());
    let end = json!({ "line": 0, "character": 0 });
    let first_id = editor.last_id + 1;
    // All at once, so that they are there when the server looks for the next one.
    let mut sent = Vec::new();
    for _ in 0..20 {
        let text = "// A word.\n";
        let changes = json!([{ "range": { "start": end, "end": end }, "text": text }]);
        sent.extend(bytes_of(&editor.changed("mission.esm", changes)));
        editor.last_id += 1;
        let id = editor.last_id;
        let method = "textDocument/hover";
        let hover = json!({ "jsonrpc": "2.0", "id": id, "method": method, "params": at });
        sent.extend(bytes_of(&hover));
    }
    editor.send_bytes(&sent);
    let mut overtaken = 0;
    let last_id = editor.last_id;
    for id in first_id..=last_id {
        let answer = loop {
            let message = editor.receive();
            if message["id"] == id {
                break message;
            }
        };
        let is_overtaken = answer["error"]["code"] == -32801;
        assert!(is_overtaken || answer["error"].is_null(), "{answer}");
        // Nothing has overtaken the last one.
        assert!(!is_overtaken || id < last_id);
        overtaken += usize::from(is_overtaken);
    }
    // How many are taken in at once is a matter of chance.
    assert!(overtaken >= 15, "{overtaken}");
    assert_eq!(editor.end(), Some(0));
}

#[test]
fn what_is_too_much_for_an_editor_is_cut() {
    let ports: String = (0..60)
        .map(|index| format!("    in data port{index}: Ranges;\n"))
        .collect();
    let tasks: String = (0..2_500)
        .map(|index| format!("task Spare{index} slot 2 {{\n{ports}}}\n"))
        .collect();
    let mistakes = "task Sonar slot 2 {}\n".repeat(1_200);
    let text = format!("{}{mistakes}{tasks}", mission());
    let mut editor = Editor::new(&[("tasks.esm", TASKS)]);
    editor.open("mission.esm", &text);
    let about = json!({ "textDocument": { "uri": editor.uri("mission.esm") } });
    let outline = editor.request("textDocument/documentSymbol", about.clone());
    let outlined = outline.as_array().unwrap().iter();
    let outlined = outlined.filter(|it| it["name"].as_str().unwrap().starts_with("S"));
    assert_eq!(outlined.count(), 1_000);
    assert_eq!(
        editor
            .labels("mission.esm", &text, "task Back: |Cruise")
            .len(),
        2_000
    );
    let at = editor.at("mission.esm", &text, "task |Spare0 ");
    let told = editor.request("textDocument/hover", at);
    let told = told["contents"]["value"].as_str().unwrap();
    assert!(
        told.contains("port28") && !told.contains("port40"),
        "{told}"
    );
    editor.diagnostics();
    assert_eq!(editor.shown["mission.esm"].len(), 1_000);
    assert_eq!(editor.end(), Some(0));
}

#[test]
fn quick_fixes_mend_what_they_are_for() {
    // Bytes, for one guess has an arrow of several.
    let mut editor = Editor::with_encodings(&[], json!(["utf-8"]));
    editor.open("mission.esm", GUESSED);
    let mut applied = 0;
    for guess in GUESSES.iter().filter(|guess| guess.has_fix) {
        let text = guess.text();
        editor.change("mission.esm", json!([{ "text": text }]));
        let actions = editor.fixes("mission.esm");
        let told = |action: &Value| {
            action["diagnostics"][0]["message"]
                .as_str()
                .unwrap()
                .to_owned()
        };
        let is_meant = |it: &&Value| told(it).contains(guess.told);
        let meant: Vec<&Value> = actions.iter().filter(is_meant).collect();
        assert!(!meant.is_empty(), "{}: {actions:?}", guess.wrong);
        for action in meant {
            let of = kind_of(&action["diagnostics"][0]);
            // It is offered where the mistake is.
            let range = action["diagnostics"][0]["range"].clone();
            let params = json!({
                "textDocument": { "uri": editor.uri("mission.esm") },
                "range": range,
                "context": { "diagnostics": action["diagnostics"], "only": ["quickfix"] },
            });
            let there = editor.request("textDocument/codeAction", params);
            assert!(there.as_array().unwrap().contains(action), "{action}");
            let shown = editor.shown["mission.esm"].iter();
            let before = shown.filter(|it| kind_of(it) == of).count();
            assert!(before > 0, "{}: {of:?} is shown", guess.wrong);

            let mended = editor.mended("mission.esm", &text, action);
            editor.change("mission.esm", json!([{ "text": mended }]));
            editor.told("mission.esm");
            let shown = editor.shown["mission.esm"].iter();
            let after = shown.filter(|it| kind_of(it) == of).count();
            assert!(
                after < before,
                "{}: {} leaves {of:?}\n{mended}",
                guess.wrong,
                action["title"]
            );
            applied += 1;
            editor.change("mission.esm", json!([{ "text": text }]));
            editor.told("mission.esm");
        }
    }
    assert!(applied > 150, "{applied}");
    assert_eq!(editor.end(), Some(0));
}

#[test]
fn quick_fixes_are_offered_where_they_belong() {
    let container = "container Inner {\n    in data twist: Twist;\n    region r { task Drive: \
        Motor; initial -> Drive; Drive -> Drive on *; }\n    path twist -> Drive.twist;\n}\n";
    let used = format!("task Motor slot 1 {{ in data twist: Twist; }}\n{container}");
    let text = "use \"inner.esm\"; interpreter slot 1; slot 1 period 10 ms duration 1 ms;
machine M { event Idle; region r { super A: Inner; state B; initial -> A; A -> B timeout; B -> A; } }
";
    let mut editor = Editor::new(&[("inner.esm", &used), ("m.esm", text)]);
    editor.open("m.esm", text);
    let titles = |actions: &[Value]| -> Vec<String> {
        let titles = actions
            .iter()
            .map(|it| it["title"].as_str().unwrap().to_owned());
        titles.collect()
    };
    let all = editor.fixes("m.esm");
    let found = titles(&all);
    assert!(
        found.iter().any(|it| it == "write the brackets"),
        "{found:?}"
    );
    // One that changes another file.
    let optional = all.iter().find(|it| it["title"] == "declare it `optional`");
    let changes = &optional.unwrap()["edit"]["changes"];
    let edits = &changes[editor.uri("inner.esm")];
    assert!(
        edited(&used, edits).contains("in data twist: Twist optional;"),
        "{changes}"
    );
    // Nothing where nothing is wrong, and nothing for those who want something else.
    let mut asked = json!({
        "textDocument": { "uri": editor.uri("m.esm") },
        "range": { "start": { "line": 0, "character": 2 }, "end": { "line": 0, "character": 3 } },
        "context": { "diagnostics": [] },
    });
    assert_eq!(
        editor.request("textDocument/codeAction", asked.clone()),
        json!([])
    );
    asked["range"]["end"]["line"] = json!(9);
    asked["context"]["only"] = json!(["refactor", "source.organizeImports"]);
    assert_eq!(
        editor.request("textDocument/codeAction", asked.clone()),
        json!([])
    );
    asked["context"]["only"] = json!(["quickfix"]);
    assert_ne!(editor.request("textDocument/codeAction", asked), json!([]));
    let nowhere = json!({ "textDocument": { "uri": "file:///nowhere.esm" }, "range": { "start": { "line": 0, "character": 0 }, "end": { "line": 0, "character": 0 } }, "context": { "diagnostics": [] } });
    assert_eq!(editor.refusal("textDocument/codeAction", nowhere).0, -32602);
    assert_eq!(editor.end(), Some(0));
}

/// A repository: one file in some uses the tasks, by way of another file or at once; nobody uses
/// the rest.
fn many_files(folder: &std::path::Path, count: usize, users: usize) {
    std::fs::write(folder.join("tasks.esm"), TASKS).unwrap();
    let library = "use \"tasks.esm\";\ncontainer Pause { region r { task Rest: Cruise; initial -> \
        Rest; Rest -> Rest on *; } }\n";
    std::fs::write(folder.join("library.esm"), library).unwrap();
    for index in 0..count - 2 {
        // Folders deeper than anybody's.
        let depth = index % 12;
        let mut path = folder.join(format!("area{}", index % 20));
        let mut up = "../".to_owned();
        for level in 0..depth {
            path.push(format!("level{level}"));
            up += "../";
        }
        std::fs::create_dir_all(&path).unwrap();
        let is_user = index * users / (count - 2) != (index + 1) * users / (count - 2);
        let text = if is_user && index % 2 == 0 {
            mission().replace("tasks.esm", &format!("{up}tasks.esm"))
        } else if is_user {
            format!(
                "// use \"nothing.esm\";\nuse \"{up}library.esm\";\ncontainer Own {{ region r {{ \
                    task Go: Cruise; initial -> Go; Go -> Go on *; }} }}\n"
            )
        } else {
            // The same name, of another task.
            mission().replace("use \"tasks.esm\";", TASKS)
        };
        std::fs::write(path.join(format!("file{index}.esm")), text).unwrap();
    }
}

#[test]
fn a_name_is_found_and_changed_among_two_thousand_files() {
    let (count, users) = (2_000, 50);
    let mut editor = Editor::new(&[]);
    many_files(editor.folder.path(), count, users);
    editor.open("tasks.esm", TASKS);
    let at = editor.at("tasks.esm", TASKS, "task |Cruise");
    editor.request("textDocument/hover", at.clone());
    let start = std::time::Instant::now();
    let found = editor.request("textDocument/references", at.clone());
    let references = start.elapsed();
    let mut files: Vec<&str> = found
        .as_array()
        .unwrap()
        .iter()
        .map(|it| it["uri"].as_str().unwrap())
        .collect();
    files.dedup();
    // Those that use it, the library and the file itself.
    assert_eq!(files.len(), users + 2);
    let mut asked = at;
    asked["newName"] = json!("Stroll");
    let start = std::time::Instant::now();
    let changes = editor.request("textDocument/rename", asked);
    let rename = start.elapsed();
    assert_eq!(changes["changes"].as_object().unwrap().len(), users + 2);
    println!("{count} files, {users} of them users: uses {references:?}, rename {rename:?}");
    assert_eq!(editor.end(), Some(0));
}

/// Measures what the book says of repositories in which all files use one.
#[test]
#[ignore = "it measures, and proves nothing that the test above does not"]
fn how_long_a_name_takes_that_two_thousand_files_use() {
    let (count, users) = (2_000, 1_998);
    let mut editor = Editor::new(&[]);
    many_files(editor.folder.path(), count, users);
    editor.open("tasks.esm", TASKS);
    let mut asked = editor.at("tasks.esm", TASKS, "task |Cruise");
    asked["newName"] = json!("Stroll");
    for method in ["references", "rename"] {
        let start = std::time::Instant::now();
        editor.request(&format!("textDocument/{method}"), asked.clone());
        println!("{users} users: {method} {:?}", start.elapsed());
    }
}
