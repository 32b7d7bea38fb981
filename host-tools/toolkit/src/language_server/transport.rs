//! Messages on a pair of byte streams: a header with the length, an empty line, a JSON text.
//!
//! Whatever comes in, reading goes on: a message that is no JSON, or too long, is reported and
//! skipped, and lines that are no header are skipped up to the next one.

use std::io::{self, BufRead, Read, Write};

use lsp_server::{ErrorCode, Message};
use serde_json::json;

/// The longest message that is read, in bytes: a source file of the greatest length with every
/// character escaped fits.
const MAX_MESSAGE_BYTES: u64 = 256 << 20;

/// The longest line of a header.
const MAX_HEADER_BYTES: u64 = 4 << 10;

/// What came in.
#[derive(Debug)]
pub enum Incoming {
    /// A message of the protocol.
    Message(Message),
    /// Something else; why it is none.
    Garbage(String),
}

/// Reads up to the end of the next message; `None` at the end of the stream.
///
/// # Errors
/// What the stream says.
pub fn read(input: &mut impl BufRead) -> io::Result<Option<Incoming>> {
    let mut length: Option<u64> = None;
    loop {
        let mut line = Vec::new();
        let read = input
            .by_ref()
            .take(MAX_HEADER_BYTES)
            .read_until(b'\n', &mut line)?;
        if read == 0 {
            return Ok(None);
        }
        let line = String::from_utf8_lossy(&line);
        let line = line.trim();
        if line.is_empty() && length.is_some() {
            break;
        }
        if let Some((name, value)) = line.split_once(':')
            && name.trim().eq_ignore_ascii_case("content-length")
        {
            length = value.trim().parse().ok();
            if length.is_none() {
                return Ok(Some(Incoming::Garbage(format!(
                    "`{}` is no length",
                    value.trim()
                ))));
            }
        }
    }
    let length = length.unwrap_or(0);
    let mut body = input.by_ref().take(length);
    if length > MAX_MESSAGE_BYTES {
        io::copy(&mut body, &mut io::sink())?;
        return Ok(Some(Incoming::Garbage(format!(
            "a message of {length} bytes is too long: at most {MAX_MESSAGE_BYTES} are read"
        ))));
    }
    let mut text = Vec::new();
    body.read_to_end(&mut text)?;
    if (text.len() as u64) < length {
        return Ok(None);
    }
    Ok(Some(match serde_json::from_slice(&text) {
        Ok(message) => Incoming::Message(message),
        Err(error) => Incoming::Garbage(error.to_string()),
    }))
}

/// Answers something that was no message.
pub(super) fn refuse(output: &mut impl Write, reason: &str) -> io::Result<()> {
    let answer = json!({
        "jsonrpc": "2.0",
        "id": null,
        "error": { "code": ErrorCode::ParseError as i32, "message": reason },
    })
    .to_string();
    write!(output, "Content-Length: {}\r\n\r\n{answer}", answer.len())?;
    output.flush()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reading_goes_on_behind_garbage() {
        let good = r#"{"jsonrpc":"2.0","method":"good"}"#;
        let framed = format!("content-length:{}\r\nX: y\r\n\r\n{good}", good.len());
        for garbage in [
            String::new(),
            "Content-Length: 3\r\n\r\n{]}".to_owned(),
            "Content-Length: many\r\n\r\n".to_owned(),
            "Content-Length: 2\r\n\r\n[]".to_owned(),
            "\r\n\r\nnothing\r\n".to_owned(),
            format!("{}\n", "x".repeat(100_000)),
            format!("Content-Length: 20000\r\n\r\n{}", "[".repeat(20_000)),
        ] {
            let stream = garbage + &framed;
            let mut input = stream.as_bytes();
            let mut messages = 0;
            while let Some(incoming) = read(&mut input).unwrap() {
                messages += usize::from(matches!(incoming, Incoming::Message(_)));
            }
            assert_eq!(messages, 1, "{:.60}", stream);
        }
        let mut cut = "Content-Length: 99999999999\r\n\r\n{".as_bytes();
        assert!(matches!(read(&mut cut), Ok(Some(Incoming::Garbage(_)))));
    }
}
