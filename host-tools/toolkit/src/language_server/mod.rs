//! A language server: what an editor shows of a mission while it is written.
//!
//! ```text
//! editor ─ bytes ─▶ transport ─ messages ─▶ Server ─ messages ─▶ transport ─ bytes ─▶ editor
//!                                             │
//!                                        documents ─ lang ─▶ sets: diagnostics, trees, references
//! ```
//!
//! A [`Session`] takes messages and writes messages; who has a thread reads ahead for it. What came
//! in while it was busy is taken together: texts are checked once for many key strokes, and a
//! request that is cancelled meanwhile is not worked on. Nor is one about a text that has changed
//! again, where a check takes so long that requests would pile up. Sets of files are checked as
//! `esm check` does, with open texts over those on disk, and kept until a text changes.
//!
//! Nothing that comes in ends it but the editor's `exit` or the end of the stream.

mod actions;
mod completion;
mod hover;
mod outline;
mod rename;
mod sets;
mod text;
mod transport;
mod uri;
mod use_index;
mod workspace;

use std::collections::{BTreeMap, BTreeSet, HashSet, VecDeque};
use std::io::{self, Write};
use std::path::PathBuf;
use std::time::Duration;

use lsp_server::{ErrorCode, Message, Notification, Request, RequestId, Response};
use lsp_types::Position;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};

use crate::lang::{Code, Diagnostic, MAX_FILE_BYTES, Overlay, Severity, Store, format};
use crate::model::Span;
use crate::schedule::Now;
use rename::{Places, Refusal};
use sets::{Document, Documents, Set, uri_of};
use text::{Encoding, Text};
pub use transport::{Incoming, read as read_message};
use use_index::UseIndex;
pub use workspace::Workspace;

/// How many diagnostics a file is shown with.
const MAX_SHOWN_DIAGNOSTICS: usize = 1_000;

/// How long a check may work for every request to get its answer. Where it takes longer, those that
/// a change has overtaken are told so.
const PROMPT: Duration = Duration::from_millis(200);

/// How the editor ended the conversation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ended {
    /// With `shutdown` and `exit`, as it should.
    InOrder,
    /// With `exit` alone, or by closing the stream.
    Abruptly,
}

/// A conversation with an editor.
pub struct Session<'w> {
    server: Server<'w>,
}

impl<'w> Session<'w> {
    /// One about files of `workspace`, which measures its work by the clock `now`.
    pub fn new(workspace: &'w dyn Workspace, now: Now) -> Self {
        Session {
            server: Server::new(workspace, now),
        }
    }

    /// Works on all that has come in since, and writes what there is to say. Gives how the
    /// conversation ended, when it has.
    ///
    /// # Errors
    /// The output cannot be written to.
    pub fn take(
        &mut self,
        mut queue: VecDeque<Incoming>,
        output: &mut impl Write,
    ) -> io::Result<Option<Ended>> {
        let server = &mut self.server;
        let cancelled = cancelled(&queue);
        let mut changes = queue.iter().filter(|it| is_change(it)).count();
        while let Some(incoming) = queue.pop_front() {
            changes -= usize::from(is_change(&incoming));
            let answers = match incoming {
                Incoming::Garbage(reason) => {
                    transport::refuse(output, &reason)?;
                    continue;
                }
                Incoming::Message(Message::Notification(note)) if note.method == "exit" => {
                    return Ok(Some(if server.is_shut_down {
                        Ended::InOrder
                    } else {
                        Ended::Abruptly
                    }));
                }
                Incoming::Message(Message::Request(request)) if cancelled.contains(&request.id) => {
                    let reason = "the editor took it back".to_owned();
                    let code = ErrorCode::RequestCanceled as i32;
                    vec![Response::new_err(request.id, code, reason).into()]
                }
                Incoming::Message(Message::Request(request))
                    if changes > 0 && server.is_slow && is_about_text(&request) =>
                {
                    let reason = "the text has changed since".to_owned();
                    let code = ErrorCode::ContentModified as i32;
                    vec![Response::new_err(request.id, code, reason).into()]
                }
                Incoming::Message(message) => server.handle(message),
            };
            for answer in answers {
                answer.write(output)?;
            }
        }
        for note in server.publish() {
            note.write(output)?;
        }
        output.flush()?;
        Ok(None)
    }
}

/// Whether a message makes what is known of the texts worthless.
fn is_change(incoming: &Incoming) -> bool {
    let Incoming::Message(Message::Notification(note)) = incoming else {
        return false;
    };
    let methods = [
        "textDocument/didOpen",
        "textDocument/didChange",
        "textDocument/didClose",
    ];
    methods.contains(&note.method.as_str())
}

/// Whether the answer to a request depends on the texts as they are now.
fn is_about_text(request: &Request) -> bool {
    request.method.starts_with("textDocument/")
}

/// Requests that are taken back by a message that has come already.
fn cancelled(queue: &VecDeque<Incoming>) -> HashSet<RequestId> {
    queue
        .iter()
        .filter_map(|incoming| match incoming {
            Incoming::Message(Message::Notification(note)) if note.method == "$/cancelRequest" => {
                serde_json::from_value(note.params.get("id")?.clone()).ok()
            }
            _ => None,
        })
        .collect()
}

/// Why a request gets no result.
struct Failure {
    code: ErrorCode,
    reason: String,
}

impl Failure {
    fn new(code: ErrorCode, reason: impl Into<String>) -> Self {
        Failure {
            code,
            reason: reason.into(),
        }
    }
}

impl From<Refusal> for Failure {
    fn from(refusal: Refusal) -> Self {
        Failure::new(ErrorCode::RequestFailed, refusal.to_string())
    }
}

type Answer = Result<Value, Failure>;

/// A file and a place in it, as most requests name it.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct At {
    text_document: Named,
    position: Position,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct About {
    text_document: Named,
}

#[derive(Deserialize)]
struct Named {
    uri: String,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Opened {
    text_document: OpenedText,
}

#[derive(Deserialize)]
struct OpenedText {
    uri: String,
    #[serde(default)]
    version: i32,
    text: String,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Changed {
    text_document: Versioned,
    content_changes: Vec<Change>,
}

#[derive(Deserialize)]
struct Versioned {
    uri: String,
    #[serde(default)]
    version: i32,
}

/// An edit, or the whole text where it names no range.
#[derive(Deserialize)]
struct Change {
    range: Option<lsp_types::Range>,
    text: String,
}

/// The state of a conversation with an editor.
struct Server<'w> {
    workspace: &'w dyn Workspace,
    now: Now,
    encoding: Option<Encoding>,
    is_shut_down: bool,
    /// The folders that the editor works in.
    folders: BTreeSet<PathBuf>,
    documents: Documents,
    /// The sets of the open files; none where a text has changed since.
    sets: Option<Vec<Set>>,
    /// Whether what is shown is out of date.
    is_dirty: bool,
    /// Whether the last check took longer than [`PROMPT`].
    is_slow: bool,
    /// Files that are shown with diagnostics.
    shown: BTreeSet<String>,
}

impl<'w> Server<'w> {
    fn new(workspace: &'w dyn Workspace, now: Now) -> Self {
        Server {
            workspace,
            now,
            encoding: None,
            is_shut_down: false,
            folders: BTreeSet::new(),
            documents: Documents::new(),
            sets: None,
            is_dirty: false,
            is_slow: false,
            shown: BTreeSet::new(),
        }
    }

    /// Takes a message in and gives what is to be sent.
    fn handle(&mut self, message: Message) -> Vec<Message> {
        match message {
            Message::Request(request) => vec![self.request(request).into()],
            Message::Notification(note) => {
                // What is wrong with a notification nobody can be told.
                if self.encoding.is_some() {
                    let _ = self.notification(note);
                }
                Vec::new()
            }
            // Nothing is asked of the editor.
            Message::Response(_) => Vec::new(),
        }
    }

    fn request(&mut self, request: Request) -> Response {
        let Request { id, method, params } = request;
        match self.answer(&method, params) {
            Ok(result) => Response::new_ok(id, result),
            Err(failure) => Response::new_err(id, failure.code as i32, failure.reason),
        }
    }

    fn answer(&mut self, method: &str, params: Value) -> Answer {
        if method == "initialize" {
            return self.initialize(&params);
        }
        if self.encoding.is_none() {
            let reason = "the first request is `initialize`";
            return Err(Failure::new(ErrorCode::ServerNotInitialized, reason));
        }
        if self.is_shut_down {
            let reason = "nothing but `exit` follows `shutdown`";
            return Err(Failure::new(ErrorCode::InvalidRequest, reason));
        }
        match method {
            "shutdown" => {
                self.is_shut_down = true;
                Ok(Value::Null)
            }
            "textDocument/definition" => self.definition(read(params)?),
            "textDocument/references" => {
                let with_declaration = params
                    .pointer("/context/includeDeclaration")
                    .and_then(Value::as_bool)
                    .unwrap_or(true);
                self.references(read(params)?, with_declaration)
            }
            "textDocument/documentHighlight" => self.highlight(read(params)?),
            "textDocument/hover" => self.hover(read(params)?),
            "textDocument/completion" => self.completion(read(params)?),
            "textDocument/prepareRename" => self.prepare_rename(read(params)?),
            "textDocument/rename" => {
                let new = params.get("newName").and_then(Value::as_str);
                let new = new.unwrap_or("").to_owned();
                self.rename(read(params)?, &new)
            }
            "textDocument/codeAction" => self.code_actions(&read(params)?),
            "textDocument/formatting" => self.formatting(&read::<About>(params)?),
            "textDocument/documentSymbol" => {
                let (set, file) = self.set_of(&read::<About>(params)?.text_document.uri)?;
                result(outline::symbols(set, file))
            }
            "textDocument/foldingRange" => {
                let (set, file) = self.set_of(&read::<About>(params)?.text_document.uri)?;
                result(outline::folding(set, file))
            }
            _ => Err(Failure::new(
                ErrorCode::MethodNotFound,
                format!("there is no method `{method}`"),
            )),
        }
    }

    fn initialize(&mut self, params: &Value) -> Answer {
        if self.encoding.is_some() {
            let reason = "this server has been initialized";
            return Err(Failure::new(ErrorCode::InvalidRequest, reason));
        }
        let offered = params
            .pointer("/capabilities/general/positionEncodings")
            .and_then(Value::as_array);
        let (name, encoding) = offered
            .into_iter()
            .flatten()
            .find_map(|offer| match offer.as_str()? {
                "utf-8" => Some(("utf-8", Encoding::Utf8)),
                "utf-16" => Some(("utf-16", Encoding::Utf16)),
                "utf-32" => Some(("utf-32", Encoding::Utf32)),
                _ => None,
            })
            .unwrap_or(("utf-16", Encoding::Utf16));
        self.encoding = Some(encoding);
        let folders = params.get("workspaceFolders").and_then(Value::as_array);
        let folders = folders.into_iter().flatten();
        let uris = folders
            .filter_map(|folder| folder.get("uri")?.as_str())
            .chain(params.get("rootUri").and_then(Value::as_str));
        self.folders = uris.filter_map(uri::to_path).collect();
        Ok(json!({
            "capabilities": {
                "positionEncoding": name,
                "textDocumentSync": { "openClose": true, "change": 2, "save": true },
                "definitionProvider": true,
                "referencesProvider": true,
                "documentHighlightProvider": true,
                "hoverProvider": true,
                "completionProvider": { "triggerCharacters": [".", "^", ":", ">", "[", " "] },
                "renameProvider": { "prepareProvider": true },
                "codeActionProvider": { "codeActionKinds": [actions::QUICK_FIX] },
                "documentFormattingProvider": true,
                "documentSymbolProvider": true,
                "foldingRangeProvider": true,
            },
            "serverInfo": { "name": "esm", "version": env!("CARGO_PKG_VERSION") },
        }))
    }

    fn notification(&mut self, note: Notification) -> Result<(), Failure> {
        match note.method.as_str() {
            "textDocument/didOpen" => {
                let OpenedText { uri, version, text } = read::<Opened>(note.params)?.text_document;
                self.open(uri, version, text);
            }
            "textDocument/didChange" => self.change(read(note.params)?),
            "textDocument/didClose" => {
                let uri = read::<About>(note.params)?.text_document.uri;
                self.documents.remove(&identity_of(self.workspace, &uri));
                self.touch();
            }
            // Files on disk may have changed.
            "textDocument/didSave" | "workspace/didChangeWatchedFiles" => self.touch(),
            _ => {}
        }
        Ok(())
    }

    fn encoding(&self) -> Encoding {
        self.encoding.unwrap_or(Encoding::Utf16)
    }

    /// Notes that what is known of the texts is out of date.
    fn touch(&mut self) {
        self.sets = None;
        self.is_dirty = true;
    }

    fn open(&mut self, uri: String, version: i32, text: String) {
        let document = Document {
            path: uri::to_path(&uri),
            version,
            text: Text::new(bounded(text), self.encoding()),
            uri,
        };
        self.documents
            .insert(identity_of(self.workspace, &document.uri), document);
        self.touch();
    }

    fn change(&mut self, changed: Changed) {
        let encoding = self.encoding();
        let Versioned { uri, version } = changed.text_document;
        // An edit of a text that was never opened has no meaning.
        let Some(document) = self.documents.get_mut(&identity_of(self.workspace, &uri)) else {
            return;
        };
        document.version = version;
        for change in changed.content_changes {
            let text = match change.range {
                Some(range) => document.text.edited(range, &change.text),
                None => change.text,
            };
            document.text = Text::new(bounded(text), encoding);
        }
        self.touch();
    }

    // ─── Sets ────────────────────────────────────────────────────────────────────────────────────

    /// Open texts as the front end takes them.
    fn open_texts(&self) -> BTreeMap<String, String> {
        self.documents
            .iter()
            .filter(|(_, document)| document.path.is_some())
            .map(|(identity, document)| (identity.clone(), document.text.as_str().to_owned()))
            .collect()
    }

    /// The sets of the open files. A file that another one uses is looked at as a part of that
    /// one's set.
    fn sets(&mut self) -> &[Set] {
        if self.sets.is_none() {
            let start = (self.now)();
            let open = self.open_texts();
            let files = Overlay::new(self.workspace, &open);
            let mut sets: Vec<Set> = Vec::new();
            for (identity, document) in &self.documents {
                if sets.iter().any(|set| set.file(identity).is_some()) {
                    continue;
                }
                let mut set = Set::of_document(identity, document, &files, self.encoding());
                set.lay_out(self.now);
                sets.retain(|other| match other.identities.first() {
                    Some(first) => set.file(first).is_none(),
                    None => false,
                });
                sets.push(set);
            }
            self.sets = Some(sets);
            self.is_slow = (self.now)().saturating_sub(start) > PROMPT;
        }
        self.sets.as_deref().unwrap_or_default()
    }

    /// A set that has an open file, and the index of the file in it.
    fn set_of(&mut self, uri: &str) -> Result<(&Set, u32), Failure> {
        let identity = identity_of(self.workspace, uri);
        self.sets()
            .iter()
            .find_map(|set| Some((set, set.file(&identity)?)))
            .ok_or_else(|| Failure::new(ErrorCode::InvalidParams, format!("{uri} is not open")))
    }

    /// A set that has an open file, the index of the file, and the byte at a place.
    fn place(&mut self, at: &At) -> Result<(&Set, u32, u32), Failure> {
        let (set, file) = self.set_of(&at.text_document.uri)?;
        let offset = set.text(file).map_or(0, |text| text.offset(at.position));
        Ok((set, file, offset as u32))
    }

    /// The URI and range of a place as the protocol gives it.
    fn location(&self, identity: &str, range: lsp_types::Range) -> Value {
        json!({ "uri": uri_of(identity, &self.documents), "range": range })
    }

    // ─── Diagnostics ─────────────────────────────────────────────────────────────────────────────

    /// What is to be shown, where that may have changed.
    fn publish(&mut self) -> Vec<Message> {
        if !std::mem::take(&mut self.is_dirty) || self.is_shut_down {
            return Vec::new();
        }
        self.sets();
        let mut found: BTreeMap<String, Vec<Value>> = self
            .documents
            .keys()
            .chain(&self.shown)
            .map(|identity| (identity.clone(), Vec::new()))
            .collect();
        let sets = self.sets.take().unwrap_or_default();
        for set in &sets {
            for diagnostic in diagnostics(set) {
                let Some((identity, range)) = set.range(diagnostic.span) else {
                    continue;
                };
                let list = found.entry(identity.to_owned()).or_default();
                let value = self.diagnostic(set, diagnostic, range);
                // Two sets that share a file may say the same of it.
                if list.len() < MAX_SHOWN_DIAGNOSTICS && (sets.len() == 1 || !list.contains(&value))
                {
                    list.push(value);
                }
            }
        }
        self.sets = Some(sets);
        self.shown.clear();
        let mut notes = Vec::new();
        for (identity, list) in found {
            let mut params = json!({
                "uri": uri_of(&identity, &self.documents),
                "diagnostics": list,
            });
            if let Some(document) = self.documents.get(&identity) {
                params["version"] = json!(document.version);
            }
            if params["diagnostics"]
                .as_array()
                .is_some_and(|it| !it.is_empty())
            {
                self.shown.insert(identity);
            }
            let method = "textDocument/publishDiagnostics".to_owned();
            notes.push(Notification { method, params }.into());
        }
        notes
    }

    fn diagnostic(&self, set: &Set, diagnostic: &Diagnostic, range: lsp_types::Range) -> Value {
        let message = match &diagnostic.hint {
            Some(hint) => format!("{}\n{hint}", diagnostic.message),
            None => diagnostic.message.clone(),
        };
        let related: Vec<Value> = diagnostic
            .related
            .iter()
            .filter_map(|(span, what)| {
                let (identity, range) = set.range(*span)?;
                Some(json!({ "location": self.location(identity, range), "message": what }))
            })
            .collect();
        json!({
            "range": range,
            "severity": match diagnostic.severity() {
                Severity::Error => 1,
                Severity::Warning => 2,
            },
            "code": diagnostic.code.as_str(),
            "source": "esm",
            "message": message,
            "relatedInformation": related,
        })
    }

    // ─── Names ───────────────────────────────────────────────────────────────────────────────────

    fn definition(&mut self, at: At) -> Answer {
        let workspace = self.workspace;
        let (set, file, offset) = self.place(&at)?;
        let tree = set.checked.trees().get(file as usize);
        let used = tree.into_iter().flat_map(|tree| &tree.uses).find_map(|it| {
            let path = it.path?;
            (path.start <= offset && offset <= path.end).then_some(path)
        });
        let target = match used {
            Some(path) => {
                let files = &set.checked.files;
                let folder = files
                    .get(file as usize)
                    .map(|file| PathBuf::from(&file.path));
                folder
                    .and_then(|file| Some(file.parent()?.join(set.source(path))))
                    .filter(|path| workspace.is_file(path))
                    .map(|path| {
                        let identity = workspace.identity(&path.to_string_lossy());
                        (identity, lsp_types::Range::default())
                    })
            }
            None => set
                .checked
                .references()
                .at(file, offset)
                .and_then(|(_, declaration)| set.range(declaration))
                .map(|(identity, range)| (identity.to_owned(), range)),
        };
        Ok(target.map_or(Value::Null, |(identity, range)| {
            self.location(&identity, range)
        }))
    }

    /// Where the name at a place is declared: the identity of the file, and the span there.
    fn declaration(&mut self, at: &At) -> Result<Option<(String, Span, Span)>, Failure> {
        let (set, file, offset) = self.place(at)?;
        let found = set.checked.references().at(file, offset);
        Ok(found.and_then(|(place, declaration)| {
            let identity = set.identities.get(declaration.file as usize)?.clone();
            Some((identity, declaration, place))
        }))
    }

    /// All places that mean what is declared somewhere: in the open sets, and in those on disk that
    /// have its file.
    fn everywhere(&mut self, identity: &str, declaration: Span) -> Everywhere {
        self.sets();
        let workspace = self.workspace;
        let open = self.open_texts();
        let files = Overlay::new(workspace, &open);
        let is_file = self
            .documents
            .get(identity)
            .is_none_or(|document| document.path.is_some());
        let (paths, is_whole) = if is_file {
            let mut folders = self.folders.clone();
            let paths = self.documents.values().filter_map(|it| it.path.as_ref());
            folders.extend(paths.filter_map(|path| path.parent().map(PathBuf::from)));
            let index = UseIndex::of(&folders, workspace, &open);
            (index.tops_above(identity), index.is_whole())
        } else {
            (Vec::new(), true)
        };
        let known = self.sets.take().unwrap_or_default();
        let mut everywhere = Everywhere {
            places: Places::new(),
            ranges: BTreeMap::new(),
            around: paths,
            is_whole,
        };
        everywhere.around.retain(|path| {
            let identity = workspace.identity(&path.to_string_lossy());
            let is_known = |set: &Set| set.identities.first() == Some(&identity);
            !known.iter().any(is_known)
        });
        for set in &known {
            everywhere.take_in(set, identity, declaration);
        }
        // One after the other: many sets at a time are too much to keep.
        for path in std::mem::take(&mut everywhere.around) {
            if let Some(set) = Set::of_path(&path, &files, self.encoding())
                && everywhere.take_in(&set, identity, declaration)
            {
                everywhere.around.push(path);
            }
        }
        for places in everywhere.places.values_mut() {
            places.sort_unstable();
            places.dedup();
        }
        self.sets = Some(known);
        everywhere
    }

    fn references(&mut self, at: At, with_declaration: bool) -> Answer {
        let Some((identity, declaration, _)) = self.declaration(&at)? else {
            return Ok(Value::Null);
        };
        let everywhere = self.everywhere(&identity, declaration);
        let mut locations = Vec::new();
        for (file, ranges) in &everywhere.ranges {
            for (&(start, _), &range) in ranges {
                let is_declaration = *file == identity && start == declaration.start;
                if with_declaration || !is_declaration {
                    locations.push(self.location(file, range));
                }
            }
        }
        Ok(Value::Array(locations))
    }

    fn highlight(&mut self, at: At) -> Answer {
        let (set, file, offset) = self.place(&at)?;
        let Some((_, declaration)) = set.checked.references().at(file, offset) else {
            return Ok(Value::Null);
        };
        let places = set.places(declaration);
        let here = places.into_iter().filter(|place| place.file == file);
        let ranges = here.filter_map(|place| Some(json!({ "range": set.range(place)?.1 })));
        Ok(ranges.collect())
    }

    fn hover(&mut self, at: At) -> Answer {
        let (set, file, offset) = self.place(&at)?;
        let Some((place, declaration)) = set.checked.references().at(file, offset) else {
            return Ok(Value::Null);
        };
        let (text, range) = (hover::text(set, declaration), set.range(place));
        Ok(match (text, range) {
            (Some(text), Some((_, range))) => json!({
                "contents": { "kind": "markdown", "value": text },
                "range": range,
            }),
            _ => Value::Null,
        })
    }

    fn completion(&mut self, at: At) -> Answer {
        let (set, file, offset) = self.place(&at)?;
        result(completion::at(set, file, offset))
    }

    /// The name at a place that can be renamed.
    fn renamed(&mut self, at: &At) -> Result<(String, Span, Span), Failure> {
        let found = self.declaration(at)?.ok_or(Refusal::Nothing)?;
        let (set, ..) = self.place(at)?;
        let is_number = set
            .source(found.1)
            .starts_with(|it: char| it.is_ascii_digit());
        if is_number {
            return Err(Refusal::Slot.into());
        }
        Ok(found)
    }

    fn prepare_rename(&mut self, at: At) -> Answer {
        let (_, _, place) = self.renamed(&at)?;
        let (set, ..) = self.place(&at)?;
        let (_, range) = set.range(place).ok_or(Refusal::Nothing)?;
        Ok(json!({ "range": range, "placeholder": set.source(place) }))
    }

    fn rename(&mut self, at: At, new: &str) -> Answer {
        rename::check_name(new)?;
        let (identity, declaration, _) = self.renamed(&at)?;
        let everywhere = self.everywhere(&identity, declaration);
        if !everywhere.is_whole {
            return Err(Refusal::TooManyFiles.into());
        }
        let (set, ..) = self.place(&at)?;
        if set.source(declaration) == new {
            return Ok(json!({ "changes": {} }));
        }
        let check = |set: &Set| match set.file(&identity) {
            Some(file) => {
                let declaration = Span {
                    file,
                    ..declaration
                };
                rename::check_meaning(set, declaration, &everywhere.places, new)
            }
            None => Ok(()),
        };
        for set in self.sets.as_deref().unwrap_or_default() {
            check(set)?;
        }
        let open = self.open_texts();
        let files = Overlay::new(self.workspace, &open);
        for path in &everywhere.around {
            if let Some(set) = Set::of_path(path, &files, self.encoding()) {
                check(&set)?;
            }
        }
        let mut changes = serde_json::Map::new();
        for (file, ranges) in &everywhere.ranges {
            let edits = ranges.values();
            let edits = edits.map(|range| json!({ "range": range, "newText": new }));
            changes.insert(uri_of(file, &self.documents), edits.collect());
        }
        Ok(json!({ "changes": changes }))
    }

    fn formatting(&mut self, about: &About) -> Answer {
        let uri = &about.text_document.uri;
        let document = self
            .documents
            .get(&identity_of(self.workspace, uri))
            .ok_or_else(|| Failure::new(ErrorCode::InvalidParams, format!("{uri} is not open")))?;
        let before = document.text.as_str();
        // What is wrong with the text is shown already.
        let Ok(after) = format::format(uri, before.as_bytes()) else {
            return Ok(Value::Null);
        };
        if before == after {
            return Ok(json!([]));
        }
        // Only what differs, in whole lines, so that the cursor stays where it is.
        let start = same_bytes(
            before
                .split_inclusive('\n')
                .zip(after.split_inclusive('\n')),
        );
        let rest_before = before.get(start..).unwrap_or("");
        let rest_after = after.get(start..).unwrap_or("");
        let last_before: Vec<&str> = rest_before.split_inclusive('\n').collect();
        let last_after: Vec<&str> = rest_after.split_inclusive('\n').collect();
        let same_end = same_bytes(
            last_before
                .into_iter()
                .rev()
                .zip(last_after.into_iter().rev()),
        );
        let end = before.len() - same_end;
        Ok(json!([{
            "range": document.text.range(start as u32, end as u32),
            "newText": rest_after.get(..rest_after.len() - same_end).unwrap_or(""),
        }]))
    }
}

/// How many bytes the first pairs have that are equal.
fn same_bytes<'t>(pairs: impl Iterator<Item = (&'t str, &'t str)>) -> usize {
    pairs
        .take_while(|(before, after)| before == after)
        .map(|(line, _)| line.len())
        .sum()
}

/// All places of a name.
struct Everywhere {
    /// Bytes, by file.
    places: Places,
    /// The same places as the editor counts them.
    ranges: BTreeMap<String, BTreeMap<(u32, u32), lsp_types::Range>>,
    /// Files that are not open, and whose sets have the declaration.
    around: Vec<PathBuf>,
    /// Whether it is known of all files around which others they use.
    is_whole: bool,
}

impl Everywhere {
    /// Adds the places in a set. Gives whether it has the file of the declaration.
    fn take_in(&mut self, set: &Set, identity: &str, declaration: Span) -> bool {
        let Some(file) = set.file(identity) else {
            return false;
        };
        let declaration = Span {
            file,
            ..declaration
        };
        for span in set.places(declaration) {
            if let Some((identity, range)) = set.range(span) {
                let place = (span.start, span.end);
                let places = self.places.entry(identity.to_owned()).or_default();
                places.push(place);
                let ranges = self.ranges.entry(identity.to_owned()).or_default();
                ranges.insert(place, range);
            }
        }
        true
    }
}

/// What is wrong with a set, as it is shown: of files that are used by others, nothing is said
/// about what these leave unused.
fn diagnostics(set: &Set) -> impl Iterator<Item = &Diagnostic> {
    set.checked
        .diagnostics
        .iter()
        .filter(|it| it.code != Code::W107 || it.span.file == 0)
}

/// What tells a document from others.
fn identity_of(store: &dyn Store, uri: &str) -> String {
    let path = uri::to_path(uri);
    path.map_or_else(
        || uri.to_owned(),
        |path| store.identity(&path.to_string_lossy()),
    )
}

/// A text that is longer than a source file may be is cut: it gets a message about its end, and
/// nothing takes long.
fn bounded(mut text: String) -> String {
    let mut end = text.len().min(MAX_FILE_BYTES as usize);
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    text.truncate(end);
    text
}

/// Reads the parameters of a request.
fn read<P: DeserializeOwned>(params: Value) -> Result<P, Failure> {
    serde_json::from_value(params)
        .map_err(|error| Failure::new(ErrorCode::InvalidParams, error.to_string()))
}

fn result(value: impl serde::Serialize) -> Answer {
    serde_json::to_value(value)
        .map_err(|error| Failure::new(ErrorCode::InternalError, error.to_string()))
}
