//! `esm lsp`: the language server that editors start.

use clap::Args;

use super::exit::CommandError;
use crate::language_server::{self, Ended};

/// Serves an editor: diagnostics, definitions, completion, renaming, layout
///
/// Speaks the Language Server Protocol on standard input and output. Editors start it; the book's chapter on editors says how
/// to set them up.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm lsp                                   started by the editor, in the folder that it works in")]
pub struct LspArgs {
    /// Standard input and output; the only way there is, and so it need not be said
    #[arg(long)]
    pub stdio: bool,
}

/// Runs the command until the editor ends the conversation.
///
/// # Errors
/// If the editor goes without saying so, or standard output cannot be written to.
pub fn execute(_args: &LspArgs) -> Result<(), CommandError> {
    match language_server::serve()? {
        Ended::InOrder => Ok(()),
        Ended::Abruptly => Err(CommandError::Told),
    }
}
