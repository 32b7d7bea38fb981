//! `esm explain`: what a code means, with a wrong and a right example.

use std::io::Write;

use anyhow::anyhow;
use clap::Args;

use super::console::Console;
use super::exit::CommandError;
use crate::lang::Code;
use crate::nearest::nearest;

/// Explains the codes of errors and warnings
///
/// Says what a code means, why it matters on the robot, and shows a file that gets it and one that
/// does not. Without CODE it lists all codes. The book has the same pages.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm explain E008
  esm explain w102
  esm explain | grep -i event")]
pub struct ExplainArgs {
    /// A code, such as E008 or W102
    #[arg(value_name = "CODE")]
    pub code: Option<String>,
}

/// Runs the command.
///
/// # Errors
/// If there is no such code, or standard output cannot be written to.
pub fn execute(args: &ExplainArgs, console: &mut Console) -> Result<(), CommandError> {
    let Some(asked) = &args.code else {
        for code in Code::ALL {
            writeln!(console.out(), "{code}  {}", title(code))?;
        }
        return Ok(());
    };
    let code = find(asked).map_err(|unknown| CommandError::Usage(anyhow!(unknown)))?;
    console.text(&for_terminal(page(code)))
}

/// The code that a word stands for, in small letters or large.
///
/// # Errors
/// A sentence with the nearest code, if there is none.
fn find(word: &str) -> Result<Code, String> {
    let wanted = word.to_ascii_uppercase();
    let found = Code::ALL.into_iter().find(|code| code.as_str() == wanted);
    found.ok_or_else(
        || match nearest(&wanted, Code::ALL.iter().map(|code| code.as_str())) {
            Some(meant) => format!("there is no code `{word}`: did you mean `{meant}`?"),
            None => format!("there is no code `{word}`: `esm explain` lists them"),
        },
    )
}

/// What a code means, in a line: the heading of its page.
fn title(code: Code) -> &'static str {
    let first_line = page(code).lines().next().unwrap_or_default();
    first_line
        .split_once(": ")
        .map_or(first_line, |(_, title)| title)
}

/// The page of a code, as the book has it.
fn page(code: Code) -> &'static str {
    macro_rules! pages {
        ($($code:ident)*) => {
            match code {
                $(Code::$code => include_str!(concat!("../../shipped/codes/", stringify!($code), ".md")),)*
            }
        };
    }
    pages!(
        E001 E002 E003 E004 E005 E006 E007 E008 E009 E010 E011 E012 E013 E014
        W101 W102 W103 W104 W105 W106 W107 W108 W109 W110 W111 W112
    )
}

// ─── Markdown for a terminal ─────────────────────────────────────────────────────────────────────

/// The widest line of prose, in characters.
const WIDTH: usize = 96;

/// Code stands so far to the right.
const CODE_INDENT: &str = "    ";

/// Rewrites the Markdown of the pages as plain text: headings without marks, code indented, lines
/// of prose broken.
fn for_terminal(markdown: &str) -> String {
    let mut text = String::new();
    let mut is_code = false;
    for line in markdown.lines() {
        if line.starts_with("```") {
            is_code = !is_code;
        } else if is_code && line.is_empty() {
            text.push('\n');
        } else if is_code {
            text += &format!("{CODE_INDENT}{line}\n");
        } else if let Some(heading) = line.strip_prefix("# ") {
            text += &format!("{heading}\n{}\n", "=".repeat(heading.chars().count()));
        } else if let Some(heading) = line.strip_prefix("## ") {
            text += &format!("{heading}\n{}\n", "-".repeat(heading.chars().count()));
        } else if let Some(item) = line.strip_prefix("- ") {
            text += &broken(&without_links(item), "- ", "  ");
        } else {
            text += &broken(&without_links(line), "", "");
        }
    }
    text
}

/// Breaks a line at blanks.
fn broken(line: &str, first: &str, others: &str) -> String {
    let mut text = String::new();
    let mut current = first.to_owned();
    let mut is_empty = true;
    for word in line.split(' ') {
        let fits = current.chars().count() + 1 + word.chars().count() <= WIDTH;
        if !is_empty && !fits {
            text += &format!("{}\n", current.trim_end());
            current = others.to_owned();
            is_empty = true;
        }
        if !is_empty {
            current.push(' ');
        }
        current += word;
        is_empty = false;
    }
    text + current.trim_end() + "\n"
}

/// Leaves of `[text](target)` the text.
fn without_links(line: &str) -> String {
    let mut text = String::new();
    let mut rest = line;
    while let Some((before, behind)) = rest.split_once("](") {
        let (Some((plain, linked)), Some((_, after))) =
            (before.rsplit_once('['), behind.split_once(')'))
        else {
            break;
        };
        text += plain;
        text += linked;
        rest = after;
    }
    text + rest
}

#[cfg(test)]
mod tests;
