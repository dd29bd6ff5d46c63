//! Access checks of requests.

use std::net::IpAddr;

use super::http::{Request, Response};

/// The checks that every request must pass first.
#[derive(Clone, Debug)]
pub(super) struct Guard {
    pub port: u16,
    /// Whether other machines may connect; a token is then required.
    pub remote: bool,
    pub token: Option<String>,
}

/// The header with the token. The query may hold it instead for a page or a picture.
const TOKEN: &str = "x-foveate-token";

impl Guard {
    /// Refuses a request with a foreign host name (DNS rebinding), without the token, with an unsupported method, or from a foreign page.
    pub(super) fn check(&self, request: &Request) -> Result<(), Response> {
        let host = request.header("host").unwrap_or_default();
        if !self.is_ours(host) {
            return Err(Response::error(
                421,
                "the Host header names another server; open the address that was printed",
            ));
        }
        if !self.has_token(request) {
            return Err(Response::error(
                401,
                "the token is missing or wrong; open the address that was printed, with its token",
            ));
        }
        if !["GET", "POST"].contains(&&*request.method) {
            return Err(Response::other_method(&request.path));
        }
        let origin = request.header("origin");
        let from_us = origin.is_some_and(|origin| origin.strip_prefix("http://") == Some(host));
        if (request.has("origin") || request.method != "GET") && !from_us {
            return Err(Response::error(403, "the request comes from another page"));
        }
        let site = request.header("sec-fetch-site");
        let typed = request.path == "/" && request.header("sec-fetch-mode") == Some("navigate");
        if site.is_some_and(|site| site != "same-origin" && site != "none") && !typed {
            return Err(Response::error(403, "the request comes from another site"));
        }
        Ok(())
    }

    /// Returns whether the host is an IP address with our port or `localhost`. Any other name could be pointed here by its owner.
    fn is_ours(&self, host: &str) -> bool {
        let (name, port) = match host.rsplit_once(':') {
            Some((name, port)) if !port.contains(']') => (name, port.parse::<u16>().ok()),
            _ => (host, Some(80)),
        };
        let bare = name.strip_prefix('[').and_then(|name| name.strip_suffix(']')).unwrap_or(name);
        let known = match bare.parse::<IpAddr>() {
            Ok(address) => self.remote || address.is_loopback(),
            Err(_) => name.eq_ignore_ascii_case("localhost"),
        };
        known && port == Some(self.port)
    }

    fn has_token(&self, request: &Request) -> bool {
        let Some(token) = &self.token else { return !self.remote };
        let given = request.header(TOKEN).or_else(|| request.query("token")).unwrap_or_default();
        // Constant time: independent of the position of the first wrong letter.
        let apart = given.bytes().zip(token.bytes()).fold(0, |apart, (a, b)| apart | (a ^ b));
        given.len() == token.len() && apart == 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ask(guard: &Guard, method: &str, headers: &[(&str, &str)]) -> u16 {
        let headers = headers.iter().map(|(n, v)| ((*n).to_owned(), (*v).to_owned())).collect();
        let request = Request { method: method.into(), path: "/api".into(), headers, ..Request::default() };
        guard.check(&request).err().map_or(200, |response| response.status)
    }

    #[test]
    fn only_our_own_page_is_answered() {
        let guard = Guard { port: 8080, remote: false, token: None };
        for host in ["127.0.0.1:8080", "localhost:8080", "LOCALHOST:8080", "[::1]:8080", "127.8.8.8:8080"] {
            assert_eq!(ask(&guard, "GET", &[("host", host)]), 200, "{host}");
        }
        for host in [
            "",
            "localhost",
            "evil.example:8080",
            "127.0.0.1:80",
            "192.168.0.7:8080",
            "localhost.evil.example:8080",
            "127.0.0.1.nip.io:8080",
            "[::1]",
            "localhost:8080:8080",
            "::1:8080:",
        ] {
            assert_eq!(ask(&guard, "GET", &[("host", host)]), 421, "{host}");
        }
        let host = ("host", "localhost:8080");
        assert_eq!(ask(&guard, "GET", &[host, host]), 421, "two hosts");
        assert_eq!(ask(&guard, "POST", &[host]), 403);
        assert_eq!(["HEAD", "OPTIONS", "PUT"].map(|method| ask(&guard, method, &[host])), [405; 3]);
        assert_eq!(ask(&guard, "POST", &[host, ("origin", "http://localhost:8080")]), 200);
        for origin in
            ["null", "http://evil.example", "https://localhost:8080", "http://localhost:8081", "http://127.0.0.1:8080"]
        {
            assert_eq!(ask(&guard, "POST", &[host, ("origin", origin)]), 403, "{origin}");
            assert_eq!(ask(&guard, "GET", &[host, ("origin", origin)]), 403, "{origin}");
        }
        assert_eq!(ask(&guard, "GET", &[host, ("sec-fetch-site", "cross-site")]), 403);
        assert_eq!(ask(&guard, "GET", &[host, ("sec-fetch-site", "same-origin")]), 200);
    }

    #[test]
    fn beyond_this_machine_the_token_is_needed() {
        let guard = Guard { port: 80, remote: true, token: Some("0123456789abcdef".into()) };
        let host = ("host", "192.168.0.7");
        for token in ["", "0123456789abcdeg", "0123456789abcde", "0123456789abcdef0"] {
            assert_eq!(ask(&guard, "GET", &[host, (TOKEN, token)]), 401);
        }
        assert_eq!(ask(&guard, "GET", &[host]), 401);
        assert_eq!(ask(&guard, "GET", &[host, (TOKEN, "0123456789abcdef")]), 200);
        assert_eq!(ask(&guard, "GET", &[("host", "evil.example"), (TOKEN, "0123456789abcdef")]), 421);
        let without = Guard { token: None, ..guard };
        assert_eq!(ask(&without, "GET", &[host]), 401, "without a token nobody comes in");
    }
}
