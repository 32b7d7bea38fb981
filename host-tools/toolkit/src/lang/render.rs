//! Diagnostics as people and programs read them.

use annotate_snippets::renderer::DecorStyle;
use annotate_snippets::{Annotation, AnnotationKind, Group, Level, Renderer, Snippet};
use serde::Serialize;

use crate::clean::clean;
use crate::model::{SourceFile, Span};

use super::diagnostic::{Diagnostic, Fix, Severity};
use super::source::Positions;

/// The most of a line that is shown before and behind a place, in bytes.
const MAX_CONTEXT_BYTES: usize = 120;

/// A diagnostic as `--json` gives it; the order of the fields is the order in the line.
#[derive(Serialize)]
struct JsonLine<'d> {
    code: &'static str,
    severity: &'static str,
    file: &'d str,
    line: u32,
    col: u32,
    message: String,
}

/// One JSON object a line.
pub(super) fn json_lines(files: &[SourceFile], diagnostics: &[Diagnostic]) -> String {
    let positions = Positions::new(files);
    diagnostics
        .iter()
        .map(|diagnostic| {
            let position = positions.of(diagnostic.span);
            let line = JsonLine {
                code: diagnostic.code.as_str(),
                severity: diagnostic.severity().as_str(),
                file: positions.path(diagnostic.span),
                line: position.line,
                col: position.col,
                message: diagnostic.text(),
            };
            // Numbers and texts always have a JSON form.
            serde_json::to_string(&line).unwrap_or_default() + "\n"
        })
        .collect()
}

/// Messages with the source lines they are about, one below the other. Words of the source in them
/// are clean where `annotate_snippets` does not see to that: it shows control characters of
/// excerpts as pictures of them, and what is left of those is cleaned where the text is written.
pub(super) fn for_people(files: &[SourceFile], diagnostics: &[Diagnostic], colour: bool) -> String {
    let renderer = if colour {
        Renderer::styled()
    } else {
        Renderer::plain()
    }
    .decor_style(DecorStyle::Ascii);
    let positions = Positions::new(files);
    let mut text = String::new();
    for diagnostic in diagnostics {
        text += &renderer.render(&[group(files, &positions, diagnostic)]);
        text += "\n\n";
    }
    text
}

fn group<'d>(
    files: &'d [SourceFile],
    positions: &Positions<'d>,
    diagnostic: &'d Diagnostic,
) -> Group<'d> {
    let level = match diagnostic.severity() {
        Severity::Error => Level::ERROR,
        Severity::Warning => Level::WARNING,
    };
    let mut group = level
        .primary_title(clean(&diagnostic.message))
        .id(diagnostic.code.as_str())
        .elements(snippet(
            files,
            positions,
            AnnotationKind::Primary,
            diagnostic.span,
            None,
        ));
    for (span, what) in &diagnostic.related {
        group = group.elements(snippet(
            files,
            positions,
            AnnotationKind::Context,
            *span,
            Some(what),
        ));
    }
    if let Some(hint) = &diagnostic.hint {
        group = group.element(Level::HELP.message(clean(hint)));
    }
    for fix in &diagnostic.fixes {
        // What is said already is not said twice.
        let title = Some(&fix.title).filter(|title| diagnostic.hint.as_ref() != Some(title));
        let line = mended_line(files, fix);
        let text = match (title, line) {
            (Some(title), Some(line)) => format!("{title}: `{line}`"),
            (Some(title), None) => title.clone(),
            (None, Some(line)) => format!("`{line}`"),
            (None, None) => continue,
        };
        group = group.element(Level::HELP.with_name("fix").message(clean(&text)));
    }
    group
}

/// The line that a fix changes, as it is afterwards: none where it changes several or leaves
/// nothing of it, or the line is long.
fn mended_line(files: &[SourceFile], fix: &Fix) -> Option<String> {
    let (first, last) = (fix.edits.first()?.span, fix.edits.last()?.span);
    let text = files.get(first.file as usize)?.text.as_str();
    let (from, to) = (first.start as usize, last.end as usize);
    if last.file != first.file || to.checked_sub(from)? > MAX_CONTEXT_BYTES {
        return None;
    }
    let near_start = floor_boundary(text, from.saturating_sub(MAX_CONTEXT_BYTES));
    let before = text.get(near_start..from)?;
    let start = match before.rfind('\n') {
        Some(at) => near_start + at + 1,
        None => Some(0).filter(|_| near_start == 0)?,
    };
    let near_end = floor_boundary(text, (to + MAX_CONTEXT_BYTES).min(text.len()));
    let behind = text.get(to..near_end)?;
    let end = match behind.find('\n') {
        Some(length) => to + length,
        None => Some(text.len()).filter(|_| near_end == text.len())?,
    };
    let mut line = text.get(start..end)?.to_owned();
    for edit in fix.edits.iter().rev() {
        let place = edit.span.start as usize - start..edit.span.end as usize - start;
        line.get(place.clone())?;
        line.replace_range(place, &edit.text);
    }
    let line = line.trim();
    (!line.is_empty() && !line.contains('\n')).then(|| line.to_owned())
}

/// The first line of a span with the place marked. Of a long line only what is near is shown.
fn snippet<'d>(
    files: &'d [SourceFile],
    positions: &Positions<'d>,
    kind: AnnotationKind,
    span: Span,
    label: Option<&'d str>,
) -> Option<Snippet<'d, Annotation<'d>>> {
    let text = files.get(span.file as usize)?.text.as_str();
    let start = (span.start as usize).min(text.len());
    // No more is looked at than is shown: a line can be megabytes long, and hold thousands of
    // mistakes.
    let near_start = floor_boundary(text, start.saturating_sub(MAX_CONTEXT_BYTES));
    let near_end = floor_boundary(text, (start + MAX_CONTEXT_BYTES).min(text.len()));
    let shown_start = text
        .get(near_start..start)?
        .rfind('\n')
        .map_or(near_start, |at| near_start + at + 1);
    let shown_end = text
        .get(start..near_end)?
        .find('\n')
        .map_or(near_end, |length| start + length);
    let shown = text.get(shown_start..shown_end)?.trim_end_matches('\r');
    let marked_start = (start - shown_start).min(shown.len());
    let marked_end = (span.end as usize)
        .saturating_sub(shown_start)
        .clamp(marked_start, shown.len());
    Some(
        Snippet::source(shown)
            .path(clean(positions.path(span)))
            .line_start(positions.of(span).line as usize)
            .annotation(kind.span(marked_start..marked_end).label(label.map(clean))),
    )
}

/// The nearest character boundary not above `at`.
fn floor_boundary(text: &str, at: usize) -> usize {
    (0..=at)
        .rev()
        .find(|&at| text.is_char_boundary(at))
        .unwrap_or(0)
}
