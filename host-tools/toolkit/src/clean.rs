//! Text on its way to a terminal. What it says may be anybody's: a robot's, a file's, a stranger's
//! on the line. Nothing in it may do anything there but be read.
//!
//! Harmful are control characters other than the end of a line (they move cursors, ring, rename
//! windows, answer as if somebody typed), and characters that nobody sees and that change how
//! others are read: those that turn the direction of writing, end a line, or are tags. Each is
//! written as its number instead.

use std::io::{self, Write};

/// How a harmful character is written instead.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// For people: `\u{1b}`.
    Text,
    /// The same, but colours pass as they are (`ESC [ numbers m`): for text that this program
    /// coloured, and cleaned before.
    Coloured,
    /// Inside of strings of JSON, where it means the same character: `\u001b`.
    Json,
}

/// Whether a character does anything to a terminal, or to how the text around it is read.
pub fn is_harmful(it: char) -> bool {
    match it {
        '\n' => false,
        // Directions of writing, and their ends.
        '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}' => {
            true
        }
        // Ends of lines and of paragraphs.
        '\u{2028}' | '\u{2029}' => true,
        // Seen by nobody: blanks of no width, operators, deprecated formats, annotations, tags.
        '\u{200b}' | '\u{2060}'..='\u{2065}' | '\u{206a}'..='\u{206f}' | '\u{feff}' => true,
        '\u{fff9}'..='\u{fffb}' | '\u{e0000}'..='\u{e0fff}' => true,
        it => it.is_control(),
    }
}

/// The text with each harmful character as its number.
pub fn clean(text: &str) -> String {
    let mut clean = String::with_capacity(text.len());
    for part in text.split_inclusive(is_harmful) {
        match part.char_indices().next_back() {
            Some((at, last)) if is_harmful(last) => {
                clean.push_str(part.get(..at).unwrap_or_default());
                clean.extend(last.escape_unicode());
            }
            _ => clean.push_str(part),
        }
    }
    clean
}

/// `no errors`, `1 error`, `2 errors`.
pub fn counted(count: u64, what: &str) -> String {
    match count {
        0 => format!("no {what}s"),
        1 => format!("1 {what}"),
        _ => format!("{count} {what}s"),
    }
}

/// Cleans what is written through it. What is no UTF-8 is written as the replacement character.
pub struct Clean<W> {
    inner: W,
    form: Form,
    /// The beginning of a character whose end has not come yet.
    pending: Vec<u8>,
}

impl<W: Write> Clean<W> {
    /// Cleans what goes to `inner`, in this form.
    pub fn new(inner: W, form: Form) -> Self {
        Clean {
            inner,
            form,
            pending: Vec::new(),
        }
    }

    /// From here on in this form.
    pub fn set_form(&mut self, form: Form) {
        self.form = form;
    }

    /// Bytes that are UTF-8 but for some.
    fn bytes(&mut self, bytes: &[u8]) -> io::Result<()> {
        let mut chunks = bytes.utf8_chunks().peekable();
        while let Some(chunk) = chunks.next() {
            self.text(chunk.valid())?;
            let rest = chunk.invalid();
            let is_cut = chunks.peek().is_none()
                && std::str::from_utf8(rest).is_err_and(|error| error.error_len().is_none());
            if is_cut {
                self.pending.extend_from_slice(rest);
            } else if !rest.is_empty() {
                write!(self.inner, "{}", char::REPLACEMENT_CHARACTER)?;
            }
        }
        Ok(())
    }

    fn text(&mut self, mut text: &str) -> io::Result<()> {
        while let Some((at, harmful)) = text.char_indices().find(|(_, it)| is_harmful(*it)) {
            let (before, from) = text.split_at(at);
            self.inner.write_all(before.as_bytes())?;
            let colour = match self.form {
                Form::Coloured => colour_length(from),
                Form::Text | Form::Json => 0,
            };
            let length = if colour > 0 {
                self.inner
                    .write_all(from.get(..colour).unwrap_or_default().as_bytes())?;
                colour
            } else {
                self.number(harmful)?;
                harmful.len_utf8()
            };
            text = from.get(length..).unwrap_or_default();
        }
        self.inner.write_all(text.as_bytes())
    }

    fn number(&mut self, harmful: char) -> io::Result<()> {
        match self.form {
            Form::Text | Form::Coloured => write!(self.inner, "{}", harmful.escape_unicode()),
            Form::Json => (harmful.encode_utf16(&mut [0; 2]).iter())
                .try_for_each(|unit| write!(self.inner, "\\u{unit:04x}")),
        }
    }
}

impl<W: Write> Write for Clean<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.pending.is_empty() {
            self.bytes(bytes)?;
        } else {
            let mut joined = std::mem::take(&mut self.pending);
            joined.extend_from_slice(bytes);
            self.bytes(&joined)?;
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        if !std::mem::take(&mut self.pending).is_empty() {
            write!(self.inner, "{}", char::REPLACEMENT_CHARACTER)?;
        }
        self.inner.flush()
    }
}

/// How many bytes of a colour the text begins with.
fn colour_length(text: &str) -> usize {
    let Some(numbers) = text.strip_prefix("\x1b[") else {
        return 0;
    };
    let rest = numbers.trim_start_matches(|it: char| it.is_ascii_digit() || it == ';');
    match rest.strip_prefix('m') {
        Some(behind) => text.len() - behind.len(),
        None => 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn written(form: Form, parts: &[&[u8]]) -> String {
        let mut bytes = Vec::new();
        let mut writer = Clean::new(&mut bytes, form);
        for part in parts {
            writer.write_all(part).unwrap();
        }
        writer.flush().unwrap();
        String::from_utf8(bytes).unwrap()
    }

    #[test]
    fn harmful_characters_are_written_as_their_numbers() {
        for (text, expected) in [
            ("plain, größer, 小さい\n", "plain, größer, 小さい\n"),
            ("\x1b]0;title\x07", "\\u{1b}]0;title\\u{7}"),
            ("a\rb\tc\x7f\0", "a\\u{d}b\\u{9}c\\u{7f}\\u{0}"),
            ("\u{9b}2J\u{85}", "\\u{9b}2J\\u{85}"),
            ("gpj\u{202e}exe", "gpj\\u{202e}exe"),
            ("\u{2028}\u{e0041}\u{feff}", "\\u{2028}\\u{e0041}\\u{feff}"),
            ("\x1b[31mred\x1b[0m", "\\u{1b}[31mred\\u{1b}[0m"),
        ] {
            assert_eq!(written(Form::Text, &[text.as_bytes()]), expected);
            assert_eq!(clean(text), expected);
        }
    }

    #[test]
    fn colours_pass_where_they_are_this_program_s_own_and_nothing_else_does() {
        for (text, expected) in [
            ("\x1b[1;31mred\x1b[0m", "\x1b[1;31mred\x1b[0m"),
            ("\x1b[m", "\x1b[m"),
            ("\x1b[2J", "\\u{1b}[2J"),
            ("\x1b[31", "\\u{1b}[31"),
            (
                "\x1b[?25l\x1b]8;;x\x1b\\",
                "\\u{1b}[?25l\\u{1b}]8;;x\\u{1b}\\",
            ),
        ] {
            assert_eq!(written(Form::Coloured, &[text.as_bytes()]), expected);
        }
    }

    #[test]
    fn what_comes_in_pieces_or_is_no_utf_8_is_seen() {
        assert_eq!(written(Form::Text, &[b"\xc2", b"\x9b"]), "\\u{9b}");
        assert_eq!(written(Form::Text, &[b"\xe2\x80", b"\xaex"]), "\\u{202e}x");
        assert_eq!(written(Form::Text, &[b"a\x9bb\xff"]), "a\u{fffd}b\u{fffd}");
        assert_eq!(written(Form::Text, &[b"a\xe2\x80"]), "a\u{fffd}");
    }

    proptest! {
        #[test]
        fn nothing_but_the_end_of_a_line_is_left_of_any_bytes(
            bytes in proptest::collection::vec(any::<u8>(), 0..60),
            cut in 0..60usize,
        ) {
            let (before, behind) = bytes.split_at(cut.min(bytes.len()));
            for form in [Form::Text, Form::Json] {
                let text = written(form, &[before, behind]);
                prop_assert!(!text.contains(is_harmful), "{text:?}");
            }
        }

        #[test]
        fn json_means_the_same_afterwards(text in any::<String>()) {
            let json = serde_json::to_string(&text).unwrap();
            let clean = written(Form::Json, &[json.as_bytes()]);
            prop_assert!(!clean.contains(is_harmful));
            prop_assert_eq!(serde_json::from_str::<String>(&clean).unwrap(), text);
        }
    }
}
