//! TraX's messages, one per line: `@@TRAX:type argument "argument" key=value ...`.

use std::io::BufRead;

use foveate::{Error, Result};

/// The prefix of every message. Lines without it are ignored.
pub(super) const PREFIX: &str = "@@TRAX:";
/// Maximum length of a line, bytes: a polygon of about 60,000 corners.
const LONGEST: usize = 1 << 20;
/// Maximum length of a property's name.
const LONGEST_KEY: usize = 64;

/// A complete or partial message.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Message {
    /// The type in lower case: initialize, frame, quit.
    pub kind: String,
    /// The values without a key.
    pub arguments: Vec<String>,
    /// The values with a key, `key=value`.
    pub properties: Vec<(String, String)>,
}

/// Returns the next message, or `None` at the end of the stream. Lines that are no messages are skipped.
///
/// # Errors
/// The stream breaks off, a line is longer than 1 MiB or not text, or a message is malformed.
pub(super) fn next(input: &mut impl BufRead) -> Result<Option<Message>> {
    loop {
        let Some(line) = line(input)? else { return Ok(None) };
        if let Some(text) = line.strip_prefix(PREFIX) {
            return parse(text).map(Some).map_err(Error::Invalid);
        }
    }
}

/// Reads a line without its end. Never holds more than the limit in memory.
fn line(input: &mut impl BufRead) -> Result<Option<String>> {
    let mut line = vec![];
    loop {
        let chunk = input.fill_buf().map_err(|e| Error::Invalid(format!("cannot read standard input: {e}")))?;
        if chunk.is_empty() && line.is_empty() {
            return Ok(None);
        }
        let end = chunk.iter().position(|b| *b == b'\n');
        let part = end.unwrap_or(chunk.len());
        if line.len() + part > LONGEST {
            let problem = format!("a line of more than {LONGEST} bytes; expected messages of TraX, a line each");
            return Err(Error::Invalid(problem));
        }
        line.extend_from_slice(&chunk[..part]);
        // The last line may lack its end.
        let (done, used) = (end.is_some() || chunk.is_empty(), part + usize::from(end.is_some()));
        input.consume(used);
        if done {
            let text = String::from_utf8(line);
            return text.map(Some).map_err(|_| Error::Invalid("a line that is not UTF-8; expected text".into()));
        }
    }
}

/// Parses the text after the prefix.
fn parse(text: &str) -> std::result::Result<Message, String> {
    let text = text.trim_end_matches('\r');
    let (kind, mut rest) = text.split_once(' ').unwrap_or((text, ""));
    let mut message = Message { kind: kind.to_ascii_lowercase(), ..Message::default() };
    loop {
        rest = rest.trim_start_matches(' ');
        if rest.is_empty() {
            return Ok(message);
        }
        let word;
        (word, rest) = match rest.strip_prefix('"') {
            Some(quoted) => unquote(quoted)?,
            None => {
                let end = rest.find(' ').unwrap_or(rest.len());
                (rest[..end].to_owned(), &rest[end..])
            }
        };
        match word.split_once('=').filter(|(key, _)| is_key(key)) {
            Some((key, value)) => message.properties.push((key.to_owned(), value.to_owned())),
            None => message.arguments.push(word),
        }
    }
}

/// Returns the text up to the closing quotation mark, and the text after it.
fn unquote(text: &str) -> std::result::Result<(String, &str), String> {
    let (mut word, mut escaped) = (String::new(), false);
    for (i, c) in text.char_indices() {
        match (escaped, c) {
            (true, 'n') => word.push('\n'),
            (true, c) => word.push(c),
            (false, '\\') => {
                escaped = true;
                continue;
            }
            (false, '"') => {
                let rest = &text[i + 1..];
                return match rest.is_empty() || rest.starts_with(' ') {
                    true => Ok((word, rest)),
                    false => Err(format!("expected a space after {:?}, found {:?}", shortened(&word), shortened(rest))),
                };
            }
            (false, c) => word.push(c),
        }
        escaped = false;
    }
    Err(format!("a quotation mark is missing after {:?}", shortened(&word)))
}

fn shortened(text: &str) -> String {
    text.chars().take(40).collect()
}

fn is_key(key: &str) -> bool {
    let allowed = |c: char| c.is_ascii_alphanumeric() || c == '.' || c == '_';
    !key.is_empty() && key.len() <= LONGEST_KEY && key.chars().all(allowed)
}

/// Formats a message as a line.
pub(super) fn format(kind: &str, arguments: &[&str], properties: &[(&str, &str)]) -> String {
    let escape = |text: &str| text.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n");
    let arguments = arguments.iter().map(|a| format!(" \"{}\"", escape(a)));
    let properties = properties.iter().map(|(key, value)| format!(" \"{key}={}\"", escape(value)));
    format!("{PREFIX}{kind}{}\n", arguments.chain(properties).collect::<String>())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &[u8]) -> Result<Option<Message>> {
        next(&mut std::io::BufReader::with_capacity(7, text))
    }

    #[test]
    fn messages_are_read_as_libtrax_reads_them() {
        let text = b"Starting\n@@TRAX:initialize \"file:///a b/1.jpg\" 1,2,3.5,4 \"label=a \\\"cat\\\"\" n=2 \r\n";
        let message = read(text).expect("a message").expect("one");
        assert_eq!(message.kind, "initialize");
        assert_eq!(message.arguments, ["file:///a b/1.jpg", "1,2,3.5,4"]);
        let own = |k: &str, v: &str| (k.to_owned(), v.to_owned());
        assert_eq!(message.properties, [own("label", "a \"cat\""), own("n", "2")]);
        // A key has no slash: a path with = is a path.
        let path = read(b"@@TRAX:frame \"file:///a=b.png\"").expect("a message").expect("one");
        assert_eq!(path.arguments, ["file:///a=b.png"]);
        assert_eq!(read(b"hello\n").expect("no message"), None);
        let line = format("state", &["a\\\"\n"], &[("confidence", "0.5")]);
        let again = read(line.as_bytes()).expect("own line").expect("one");
        assert_eq!((again.arguments, again.properties), (vec!["a\\\"\n".into()], vec![own("confidence", "0.5")]));
    }

    #[test]
    fn damage_is_an_error() {
        let long = [b"@@TRAX:frame ".to_vec(), vec![b'a'; LONGEST]].concat();
        for (text, said) in [
            (&b"@@TRAX:frame \"file"[..], "quotation mark is missing"),
            (b"@@TRAX:frame \"a\"b", "expected a space"),
            (b"@@TRAX:frame \xff\n", "not UTF-8"),
            (&long, "more than 1048576 bytes"),
        ] {
            let problem = read(text).expect_err(said).to_string();
            assert!(problem.contains(said), "{problem}");
        }
        // The error quotes only part of a long message.
        for end in ["", "\"x"] {
            let text = format!("@@TRAX:frame \"{}{end}{}", "é".repeat(100_000), "é".repeat(100_000));
            let problem = read(text.as_bytes()).expect_err("damage").to_string();
            assert!(problem.contains(&"é".repeat(40)) && problem.len() < 300, "{} bytes", problem.len());
        }
    }
}
