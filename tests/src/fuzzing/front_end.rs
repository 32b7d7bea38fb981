//! Any bytes as a set of `.esm` files.

use std::time::Duration;

use host_tools::compile::{self, CompileError};
use host_tools::diagram;
use host_tools::lang::{self, Checked, Severity};
use host_tools::model::Span;
use host_tools::schedule;
use host_tools::time::work_limit;

use super::Chosen;

/// A line that starts with this begins the next file of the set; the rest of the line is its path.
/// Files without it are one file.
pub const FILE_MARK: &str = "//// ";

/// Path of the first file.
const FIRST_PATH: &str = "main.esm";

/// How long start times are searched for. Found or not, nothing else depends on it.
const LAY_OUT_LIMIT: Duration = Duration::from_millis(20);

/// Missions with more containers or transitions are not drawn: that takes long, and shows nothing
/// new.
const MAX_DRAWN_CONTAINERS: usize = 6;
const MAX_DRAWN_TRANSITIONS: usize = 60;

/// Longer texts are not laid out, for the same reason.
const MAX_LAID_OUT_BYTES: usize = 8_192;

/// Start times are searched for up to so many slots.
const MAX_SLOTS: usize = 12;

/// Checks the bytes, renders what was found, and compiles what is right. What takes long is done
/// with one input in some.
///
/// # Panics
/// Where a law does not hold.
pub fn front_end(bytes: &[u8]) {
    let chosen = Chosen::by(bytes);
    let files = split(bytes);
    let mut checked = lang::load_files(&files);
    check_diagnostics(&checked);
    if chosen.one_in(3, 0) {
        let again = lang::load_files(&files);
        assert_eq!(
            checked.diagnostics, again.diagnostics,
            "one answer to one question"
        );
        check_rendering(&checked, &again);
    }
    if bytes.len() <= MAX_LAID_OUT_BYTES && chosen.one_in(2, 8) {
        check_layout(&files, &checked);
    }

    checked.require_machine();
    if checked.slots().len() > MAX_SLOTS {
        return;
    }
    let schedule = checked.lay_out(work_limit(LAY_OUT_LIMIT));
    check_diagnostics(&checked);
    let Some(model) = &checked.model else {
        return;
    };
    let transitions = model.containers.iter().flat_map(|it| &it.regions);
    let transitions: usize = transitions.map(|region| region.transitions.len()).sum();
    if model.containers.len() <= MAX_DRAWN_CONTAINERS
        && transitions <= MAX_DRAWN_TRANSITIONS
        && chosen.one_in(8, 16)
    {
        // Too large or too tangled is an answer, too.
        let _ = diagram::draw(model, &diagram::Options::default());
    }
    let Some(schedule) = schedule else {
        panic!("no error, and yet no schedule");
    };
    assert_eq!(
        schedule::check(checked.slots(), &schedule.starts_us),
        Ok(())
    );
    let blob = compile::compile(model, &schedule);
    if chosen.one_in(4, 20) {
        assert_eq!(blob, compile::compile(model, &schedule));
    }
    match blob {
        Ok(blob) => assert!(esm_core::verify(blob).is_ok()),
        Err(CompileError::Limit {
            found,
            limit,
            capacity,
            ..
        }) => assert!(found > limit, "{found} {capacity} are not above {limit}"),
        Err(CompileError::NothingToRun { .. }) => {}
        Err(error) => panic!("files without errors do not compile: {error}"),
    }
}

/// The files of a set, the first one first. A path that comes twice is the last one's.
pub fn split(bytes: &[u8]) -> Vec<(&str, &[u8])> {
    let mut files = vec![(FIRST_PATH, 0, bytes.len())];
    let mut start = 0;
    for line in bytes.split_inclusive(|&byte| byte == b'\n') {
        let end = start + line.len();
        let path = line.strip_prefix(FILE_MARK.as_bytes());
        if let Some(path) = path.and_then(|path| std::str::from_utf8(path).ok()) {
            if let Some(last) = files.last_mut() {
                last.2 = start;
            }
            files.push((path.trim(), end, bytes.len()));
        }
        start = end;
    }
    files
        .into_iter()
        .map(|(path, start, end)| (path, &bytes[start..end]))
        .collect()
}

/// Each has a place that exists, and they come in order.
fn check_diagnostics(checked: &Checked) {
    let errors = checked
        .diagnostics
        .iter()
        .any(|found| found.severity() == Severity::Error);
    assert_eq!(checked.has_errors(), errors);
    assert_eq!(checked.model.is_none(), errors, "a model, or an error");
    assert!(
        checked
            .diagnostics
            .is_sorted_by_key(|found| (found.span, found.code)),
        "by file, place and code"
    );
    for found in &checked.diagnostics {
        check_place(checked, found.span);
        for (span, _) in &found.related {
            check_place(checked, *span);
        }
        let text = found.text();
        assert!(!found.message.is_empty());
        assert!(
            !text.contains(char::is_control),
            "{text:?} would move the cursor"
        );
    }
}

fn check_place(checked: &Checked, span: Span) {
    let file = checked
        .files
        .get(span.file as usize)
        .expect("a file of the set");
    let (start, end) = (span.start as usize, span.end as usize);
    assert!(start <= end && end <= file.text.len(), "{span:?}");
    let text = file.text.get(start..end);
    assert!(text.is_some(), "{span:?} cuts a character");
}

/// Files that are laid out mean what they meant before, get the same messages, and stay as they are
/// when they are laid out again.
fn check_layout(files: &[(&str, &[u8])], checked: &Checked) {
    // Of a file that nobody uses, nothing was said.
    let is_in_set = |path: &str| checked.files.iter().any(|file| file.path == path);
    let mut laid_out = Vec::new();
    for (path, bytes) in files.iter().filter(|(path, _)| is_in_set(path)) {
        let Ok(text) = lang::format::format(path, bytes) else {
            assert!(checked.has_errors(), "what is right can be laid out");
            return;
        };
        let again = lang::format::format(path, text.as_bytes());
        assert!(
            again.is_ok_and(|again| again == text),
            "laid out twice:\n{text}"
        );
        laid_out.push((*path, text));
    }
    let files: Vec<(&str, &[u8])> = laid_out
        .iter()
        .map(|(path, text)| (*path, text.as_bytes()))
        .collect();
    let after = lang::load_files(&files);
    let said = |checked: &Checked| -> Vec<_> {
        let all = checked.diagnostics.iter();
        all.map(|found| (found.code, found.text())).collect()
    };
    assert_eq!(said(checked), said(&after));
    assert_eq!(compiled(checked), compiled(&after), "it means the same");
}

/// The blob of files without errors, as if all slots started at 0; none where there is one error or
/// too much of something.
fn compiled(checked: &Checked) -> Option<Vec<u8>> {
    let model = checked.model.as_ref()?;
    compile::compile(model, &vec![0; model.slots.len()]).ok()
}

/// What people and programs get: all of it, and each time the same.
fn check_rendering(checked: &Checked, again: &Checked) {
    let plain = checked.render(false);
    assert_eq!(plain, again.render(false));
    let coloured = checked.render(true);
    assert_eq!(plain.is_empty(), coloured.is_empty());
    let lines = checked.json_lines();
    assert_eq!(lines, again.json_lines());
    assert_eq!(lines.lines().count(), checked.diagnostics.len());
    for (line, found) in lines.lines().zip(&checked.diagnostics) {
        let line: serde_json::Value = serde_json::from_str(line).expect("JSON");
        assert_eq!(line["code"], found.code.as_str());
        assert_eq!(line["severity"], found.severity().as_str());
        let place = checked.position(found.span);
        assert_eq!(
            (&line["line"], &line["col"]),
            (&place.line.into(), &place.col.into())
        );
        assert!(place.line >= 1 && place.col >= 1);
        assert!(plain.contains(found.code.as_str()));
    }
}

#[cfg(test)]
mod tests {
    use super::split;

    #[test]
    fn marked_lines_begin_files() {
        let text = b"use \"a\";\n//// a\nslot\n//// b/c \n";
        let expected: [(&str, &[u8]); 3] = [
            ("main.esm", b"use \"a\";\n"),
            ("a", b"slot\n"),
            ("b/c", b""),
        ];
        assert_eq!(split(text), expected);
        assert_eq!(split(b""), [("main.esm", &b""[..])]);
    }
}
