//! A minimal HTTP/1.1 server over a stream, with all sizes bounded.

use std::fs::File;
use std::io::{Read, Write};
use std::time::{Duration, Instant};

/// Maximum size of a request's first line and headers, bytes.
pub(super) const MOST_HEAD: usize = 16 << 10;
/// Maximum number of request headers.
const MOST_HEADERS: usize = 64;
/// Maximum size of a request's body, bytes.
pub(super) const MOST_BODY: usize = 64 << 10;
/// Maximum size of an uploaded picture, bytes; accepted only from the page.
pub(super) const MOST_PICTURE: usize = 2 << 20;
/// Time limit for receiving a request, from its first byte.
const PATIENCE: Duration = Duration::from_secs(20);

/// A complete request.
#[derive(Debug, Default)]
pub(super) struct Request {
    pub method: String,
    /// The path without the query, not decoded.
    pub path: String,
    /// Names and values of the query, not decoded.
    pub query: Vec<(String, String)>,
    /// Headers with lower-case names, and their values.
    pub headers: Vec<(String, String)>,
    pub body: Vec<u8>,
    /// Whether to keep the connection for another request.
    pub keep: bool,
}

impl Request {
    /// Returns a header that occurs exactly once, otherwise `None`.
    pub(super) fn header(&self, name: &str) -> Option<&str> {
        let mut all = self.headers.iter().filter(|(n, _)| n == name);
        all.next().filter(|_| all.next().is_none()).map(|(_, value)| &**value)
    }
    /// Returns whether a header occurs at least once.
    pub(super) fn has(&self, name: &str) -> bool {
        self.headers.iter().any(|(n, _)| n == name)
    }
    /// Returns a value of the query.
    pub(super) fn query(&self, name: &str) -> Option<&str> {
        self.query.iter().find(|(n, _)| n == name).map(|(_, value)| &**value)
    }
}

/// A response.
#[derive(Debug)]
pub(super) struct Response {
    pub status: u16,
    /// Its media type.
    pub kind: &'static str,
    pub body: Vec<u8>,
    /// A file to send after the body, and the number of its bytes; it is read while it is sent.
    pub file: Option<(File, u64)>,
    /// Further headers, with values from this program only.
    pub headers: Vec<(&'static str, String)>,
}

impl Response {
    pub(super) fn new(status: u16, kind: &'static str, body: impl Into<Vec<u8>>) -> Self {
        Self { status, kind, body: body.into(), file: None, headers: vec![] }
    }
    /// Returns the response for an unsupported method of this path.
    pub(super) fn other_method(path: &str) -> Self {
        let allowed = if ["/api", "/push"].contains(&path) { "POST" } else { "GET" };
        let refusal = Self::error(405, "another method is needed here");
        Self { headers: vec![("Allow", allowed.into())], ..refusal }
    }
    /// Returns an error response as JSON.
    pub(super) fn error(status: u16, what: &str) -> Self {
        Self::new(status, "application/json", serde_json::json!({ "error": what }).to_string())
    }
}

/// The reason why no request was read.
#[derive(Debug)]
pub(super) enum Ended {
    /// The peer closed the connection or timed out.
    Gone,
    /// The request is not supported: respond and close.
    Refused(u16, &'static str),
}

/// The server's side of a connection.
pub(super) struct Connection<S> {
    stream: S,
    buffer: Vec<u8>,
}

impl<S: Read + Write> Connection<S> {
    pub(super) fn new(stream: S) -> Self {
        Self { stream, buffer: vec![] }
    }

    /// Reads the next request. `trusted` decides from its head whether a body of picture size is accepted.
    pub(super) fn request(&mut self, trusted: &dyn Fn(&Request) -> bool) -> Result<Request, Ended> {
        let mut began: Option<Instant> = (!self.buffer.is_empty()).then(Instant::now);
        let (mut request, head, length) = loop {
            if let Some(parsed) = head(&self.buffer)? {
                break parsed;
            }
            if self.buffer.len() >= MOST_HEAD {
                return Err(Ended::Refused(431, "the request's headers are too large"));
            }
            self.more(&mut began)?;
        };
        if length > MOST_BODY && !(request.path == "/push" && length <= MOST_PICTURE && trusted(&request)) {
            return Err(Ended::Refused(413, "the request's body is too large"));
        }
        while self.buffer.len() < head + length {
            self.more(&mut began)?;
        }
        request.body = self.buffer[head..head + length].to_vec();
        self.buffer.drain(..head + length);
        Ok(request)
    }

    fn more(&mut self, began: &mut Option<Instant>) -> Result<(), Ended> {
        if began.is_some_and(|began| began.elapsed() > PATIENCE) {
            return Err(Ended::Refused(408, "the request took too long to come"));
        }
        let mut bytes = [0; 16384];
        match self.stream.read(&mut bytes) {
            Ok(n) if n > 0 => {
                began.get_or_insert_with(Instant::now);
                self.buffer.extend_from_slice(&bytes[..n]);
                Ok(())
            }
            _ => Err(Ended::Gone),
        }
    }

    /// Sends a response.
    pub(super) fn respond(&mut self, response: &Response, keep: bool) -> std::io::Result<()> {
        let mut head = format!(
            "HTTP/1.1 {} {}\r\nContent-Type: {}\r\nContent-Length: {}\r\nConnection: {}\r\n\
             X-Content-Type-Options: nosniff\r\nReferrer-Policy: no-referrer\r\nX-Frame-Options: DENY\r\n\
             Cross-Origin-Resource-Policy: same-origin\r\nCross-Origin-Opener-Policy: same-origin\r\nCache-Control: no-store\r\n",
            response.status,
            reason(response.status),
            response.kind,
            response.body.len() as u64 + response.file.as_ref().map_or(0, |(_, length)| *length),
            if keep { "keep-alive" } else { "close" },
        );
        for (name, value) in &response.headers {
            head.push_str(&format!("{name}: {value}\r\n"));
        }
        head.push_str("\r\n");
        self.stream.write_all(head.as_bytes())?;
        self.stream.write_all(&response.body)?;
        if let Some((file, length)) = &response.file {
            let sent = std::io::copy(&mut file.take(*length), &mut self.stream)?;
            if sent < *length {
                return Err(std::io::ErrorKind::UnexpectedEof.into());
            }
        }
        self.stream.flush()
    }

    /// Returns the underlying stream.
    pub(super) fn stream(&mut self) -> &mut S {
        &mut self.stream
    }
}

/// Parses the head of a request: returns the request, the head's length and the body's length, or `None` if bytes are missing.
fn head(bytes: &[u8]) -> Result<Option<(Request, usize, usize)>, Ended> {
    let mut headers = [httparse::EMPTY_HEADER; MOST_HEADERS];
    let mut parsed = httparse::Request::new(&mut headers);
    let size = match parsed.parse(bytes) {
        Ok(httparse::Status::Complete(size)) if size <= MOST_HEAD => size,
        Ok(httparse::Status::Complete(_)) | Err(httparse::Error::TooManyHeaders) => {
            return Err(Ended::Refused(431, "the request's headers are too large"));
        }
        Ok(httparse::Status::Partial) => return Ok(None),
        Err(_) => return Err(Ended::Refused(400, "this is no HTTP request")),
    };
    let all =
        parsed.headers.iter().map(|h| (h.name.to_ascii_lowercase(), String::from_utf8_lossy(h.value).into_owned()));
    let target = parsed.path.unwrap_or_default();
    let (path, query) = target.split_once('?').unwrap_or((target, ""));
    let query = query.split('&').filter_map(|part| part.split_once('=')).map(|(n, v)| (n.to_owned(), v.to_owned()));
    let request = Request {
        method: parsed.method.unwrap_or_default().to_owned(),
        path: path.to_owned(),
        query: query.collect(),
        headers: all.collect(),
        body: vec![],
        keep: parsed.version == Some(1),
    };
    if request.has("transfer-encoding") {
        return Err(Ended::Refused(501, "a body must come with its Content-Length"));
    }
    let length = match request.header("content-length") {
        Some(text) if !text.is_empty() && text.len() <= 9 && text.bytes().all(|b| b.is_ascii_digit()) => {
            text.parse().unwrap_or(usize::MAX)
        }
        None if !request.has("content-length") => 0,
        _ => return Err(Ended::Refused(400, "Content-Length is one number")),
    };
    let close = request.header("connection").is_some_and(|c| c.eq_ignore_ascii_case("close"));
    Ok(Some((Request { keep: request.keep && !close, ..request }, size, length)))
}

fn reason(status: u16) -> &'static str {
    match status {
        200 => "OK",
        400 => "Bad Request",
        401 => "Unauthorized",
        403 => "Forbidden",
        404 => "Not Found",
        405 => "Method Not Allowed",
        408 => "Request Timeout",
        413 => "Content Too Large",
        415 => "Unsupported Media Type",
        421 => "Misdirected Request",
        431 => "Request Header Fields Too Large",
        501 => "Not Implemented",
        503 => "Service Unavailable",
        _ => "Internal Server Error",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A reader that returns a few bytes per call.
    struct Slow(Vec<u8>, usize);

    impl Read for Slow {
        fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
            let n = self.1.min(self.0.len()).min(out.len());
            out[..n].copy_from_slice(&self.0[..n]);
            self.0.drain(..n);
            Ok(n)
        }
    }
    impl Write for Slow {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            Ok(bytes.len())
        }
        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }

    fn read(text: &str, step: usize) -> (Result<Request, Ended>, usize) {
        let mut connection = Connection::new(Slow(text.as_bytes().to_vec(), step));
        let request = connection.request(&|request| request.header("host") == Some("trusted"));
        (request, connection.buffer.len() + connection.stream.0.len())
    }

    #[test]
    fn requests_are_read_whole_however_they_come() {
        let text =
            "POST /api?a=1&token=%2e HTTP/1.1\r\nHost: x:1\r\nContent-Length: 3\r\n\r\nabcGET / HTTP/1.1\r\n\r\n";
        for step in [1, 7, 4000] {
            let (request, left) = read(text, step);
            let request = request.expect("a request");
            assert_eq!((&*request.method, &*request.path, &*request.body), ("POST", "/api", &b"abc"[..]));
            assert_eq!((request.query("token"), request.header("host")), (Some("%2e"), Some("x:1")));
            assert!(request.keep && left == 18, "the next request stays: {left}");
        }
    }

    #[test]
    fn sizes_are_bounded() {
        let status = |text: &str| match read(text, 4000).0 {
            Err(Ended::Refused(status, _)) => status,
            Err(Ended::Gone) => 0,
            Ok(_) => 200,
        };
        let with = |headers: &str| status(&format!("GET / HTTP/1.1\r\n{headers}\r\n\r\n"));
        assert_eq!(with(&format!("A: {}", "x".repeat(MOST_HEAD))), 431);
        assert_eq!(with(&"A: b\r\n".repeat(70)), 431);
        assert_eq!(status(&"G".repeat(2 * MOST_HEAD)), 431);
        assert_eq!(with("Content-Length: 65537"), 413);
        let push = |host: &str, length: usize| {
            let body = "x".repeat(length);
            status(&format!("POST /push?a=1 HTTP/1.1\r\nHost: {host}\r\nContent-Length: {length}\r\n\r\n{body}"))
        };
        assert_eq!(
            [push("trusted", MOST_PICTURE), push("trusted", MOST_PICTURE + 1), push("else", MOST_BODY + 1)],
            [200, 413, 413]
        );
        assert_eq!(with("Content-Length: 99999999999999999999"), 400);
        assert_eq!(with("Content-Length: -1"), 400);
        assert_eq!(with("Content-Length: 1\r\nContent-Length: 2"), 400);
        assert_eq!(with("Transfer-Encoding: chunked"), 501);
        assert_eq!(status("\u{1}\r\n\r\n"), 400);
        assert_eq!(status("GET / HTTP/1.1\r\n"), 0);
        assert_eq!(status("POST / HTTP/1.1\r\nContent-Length: 5\r\n\r\nab"), 0);
    }
}
