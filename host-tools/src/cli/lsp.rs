//! `esm lsp`: the language server that editors start.

use std::collections::VecDeque;
use std::io::{self, BufReader};
use std::sync::mpsc::{self, Receiver, SyncSender};

use clap::Args;
use esm_client::sources::Disk;

use super::exit::CommandError;
use crate::language_server::{Ended, Incoming, Session, read_message};
use crate::time::work_taken;

/// Serves an editor: diagnostics, definitions, completion, renaming, layout
///
/// Speaks the Language Server Protocol on standard input and output. Editors start it; the book's
/// chapter on editors says how to set them up.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm lsp                                   started by the editor, in the folder that it works in")]
pub struct LspArgs {
    /// Standard input and output; the only way there is, and so it need not be said
    #[arg(long)]
    pub stdio: bool,
}

/// How many messages are read ahead.
const MESSAGES_AHEAD: usize = 256;

/// Runs the command until the editor ends the conversation.
///
/// # Errors
/// If the editor goes without saying so, or standard output cannot be written to.
pub fn execute(_args: &LspArgs) -> Result<(), CommandError> {
    match serve()? {
        Ended::InOrder => Ok(()),
        Ended::Abruptly => Err(CommandError::Told),
    }
}

/// Serves an editor on standard input and output. A second thread reads, so that what comes in
/// during a check is taken together.
fn serve() -> io::Result<Ended> {
    let (sender, receiver) = mpsc::sync_channel(MESSAGES_AHEAD);
    // It ends with the stream, or with the process.
    std::thread::spawn(move || read_all(&sender));
    #[expect(
        clippy::disallowed_methods,
        reason = "the other end is an editor, which reads messages and no text"
    )]
    let mut output = io::stdout().lock();
    let mut session = Session::new(&Disk, work_taken);
    while let Some(incoming) = take_in(&receiver) {
        if let Some(ended) = session.take(incoming, &mut output)? {
            return Ok(ended);
        }
    }
    Ok(Ended::Abruptly)
}

fn read_all(sender: &SyncSender<Incoming>) {
    let mut input = BufReader::new(io::stdin());
    while let Ok(Some(incoming)) = read_message(&mut input) {
        if sender.send(incoming).is_err() {
            return;
        }
    }
}

/// Waits for a message, then takes all that have come; `None` after the last.
fn take_in(receiver: &Receiver<Incoming>) -> Option<VecDeque<Incoming>> {
    let mut queue = VecDeque::from([receiver.recv().ok()?]);
    queue.extend(receiver.try_iter().take(MESSAGES_AHEAD));
    Some(queue)
}
