//! The page: one document with its style and scripts, and its content security policy.

use std::sync::OnceLock;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use foveate::report::{BRAND, SCRIPT, STYLE, fill};
use sha2::{Digest, Sha256};

use super::http::Response;

/// Returns the document, and the policy that permits only its own style, its own script and connections to this server.
fn page() -> &'static (String, String) {
    static PAGE: OnceLock<(String, String)> = OnceLock::new();
    PAGE.get_or_init(|| {
        let style = format!("{STYLE}\n{}", foveate_page::STYLE);
        let script = format!("{SCRIPT}{}{}", include_str!("page/tracker.js"), foveate_page::SCRIPT);
        let hash = |text: &str| format!("'sha256-{}'", STANDARD.encode(Sha256::digest(text)));
        let policy = format!(
            "default-src 'none'; script-src {}; style-src {}; img-src 'self' blob: data:; connect-src 'self'; base-uri 'none'; \
             form-action 'none'; frame-ancestors 'none'",
            hash(&script),
            hash(&style)
        );
        let cards = foveate_page::CARDS.into();
        let parts = [("style", style), ("script", script), ("brand", BRAND.into()), ("cards", cards)];
        let html = fill(include_str!("page/page.html"), &parts);
        (html, policy)
    })
}

/// Returns the page as a response.
pub(super) fn response() -> Response {
    let (html, policy) = page();
    let mut response = Response::new(200, "text/html; charset=utf-8", html.as_bytes());
    response.headers.push(("Content-Security-Policy", policy.clone()));
    response
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_is_one_document_without_foreign_parts() {
        let (html, policy) = page();
        for word in ["http://", "https://", "@import", " src=", "style=\"", "onclick", "eval(", "new Function"] {
            let found = html.find(word).map(|at| &html[at..(at + 60).min(html.len())]);
            assert!(found.is_none_or(|text| text.starts_with("http://www.w3.org/")), "{word}: {found:?}");
        }
        assert_eq!(html.matches("<script>").count(), 1);
        assert!(policy.contains("script-src 'sha256-") && !policy.contains("unsafe"));
    }
}
