//! Quick fixes: changes of the text that make what is shown go away.

use std::collections::BTreeMap;

use lsp_types::Range;
use serde::Deserialize;
use serde_json::{Value, json};

use crate::lang::Fix;

use super::sets::{Set, uri_of};
use super::{Answer, Named, Server, diagnostics, identity_of};

/// The kind of all actions here, as the protocol names it.
pub(super) const QUICK_FIX: &str = "quickfix";

/// What an editor asks for.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Asked {
    text_document: Named,
    range: Range,
    #[serde(default)]
    context: Context,
}

#[derive(Default, Deserialize)]
struct Context {
    only: Option<Vec<String>>,
}

impl Server<'_> {
    /// The fixes of what is shown in a part of a file.
    pub(super) fn code_actions(&mut self, asked: &Asked) -> Answer {
        let identity = identity_of(self.workspace, &asked.text_document.uri);
        let only = asked.context.only.as_deref();
        if only.is_some_and(|kinds| {
            !kinds
                .iter()
                .any(|kind| kind.is_empty() || kind == QUICK_FIX)
        }) {
            return Ok(json!([]));
        }
        self.set_of(&asked.text_document.uri)?;
        let sets = self.sets.take().unwrap_or_default();
        let mut actions: Vec<Value> = Vec::new();
        for set in sets.iter().filter(|set| set.file(&identity).is_some()) {
            for diagnostic in diagnostics(set).filter(|it| !it.fixes.is_empty()) {
                let Some((file, range)) = set.range(diagnostic.span) else {
                    continue;
                };
                let meets = range.start <= asked.range.end && asked.range.start <= range.end;
                if file != identity || !meets {
                    continue;
                }
                let shown = self.diagnostic(set, diagnostic, range);
                for fix in &diagnostic.fixes {
                    let Some(edit) = self.edit(set, fix) else {
                        continue;
                    };
                    let action = json!({
                        "title": fix.title,
                        "kind": QUICK_FIX,
                        "diagnostics": [shown],
                        "isPreferred": diagnostic.fixes.len() == 1,
                        "edit": edit,
                    });
                    // Two sets that share a file may say the same of it.
                    if !actions.contains(&action) {
                        actions.push(action);
                    }
                }
            }
        }
        self.sets = Some(sets);
        Ok(Value::Array(actions))
    }

    /// A fix as the protocol gives it; none where a place of it is in no file of the set.
    fn edit(&self, set: &Set, fix: &Fix) -> Option<Value> {
        let mut changes: BTreeMap<String, Vec<Value>> = BTreeMap::new();
        for edit in &fix.edits {
            let (identity, range) = set.range(edit.span)?;
            let uri = uri_of(identity, &self.documents);
            let edits = changes.entry(uri).or_default();
            edits.push(json!({ "range": range, "newText": edit.text }));
        }
        Some(json!({ "changes": changes }))
    }
}
