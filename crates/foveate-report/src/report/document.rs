//! Pages of text, tables and charts without scripts: evaluations, reproductions, lists of runs.

use super::html::{BRAND, STYLE, escape, fill};

/// The colours of this project's charts, and the style variables that replace them on a page.
const INKS: [(&str, &str); 11] = [
    ("white", "card"),
    ("black", "ink"),
    ("#000000", "ink"),
    ("#cccccc", "line"),
    ("#888888", "soft"),
    ("#0072b2", "target"),
    ("#d55e00", "lost"),
    ("#b33c00", "lost"),
    ("#009e73", "second"),
    ("#cc79a7", "third"),
    ("#e69f00", "gaze"),
];

/// Returns a page with the style of the reports. `title` is text; `verdict` (the first sentence), `about` (one more line) and `body` are
/// HTML. The page loads nothing and runs nothing.
pub fn document(title: &str, verdict: &str, about: &str, body: &str) -> String {
    let parts = [
        ("title", escape(title)),
        ("style", STYLE.into()),
        ("brand", BRAND.into()),
        ("verdict", verdict.into()),
        ("about", about.into()),
        ("body", body.into()),
    ];
    fill(include_str!("document.html"), &parts)
}

/// Returns a section of a [`document`]: its heading (text), and its content (HTML).
pub fn card(heading: &str, content: &str) -> String {
    format!("<section class=\"card\"><h2>{}</h2>\n{content}</section>\n", escape(heading))
}

/// Embeds a chart in a page: scales the SVG text of this project's plots to the available width and uses the colours of the page, light or
/// dark. `label` (text) describes it.
pub fn drawing(svg: &str, label: &str) -> String {
    let (head, rest) = svg.split_once('>').unwrap_or(("", svg));
    let side = |name: &str| {
        let value = head.split_once(&format!(" {name}=\"")).and_then(|(_, rest)| rest.split('"').next());
        value.and_then(|value| value.parse::<f64>().ok()).unwrap_or(100.0)
    };
    let (width, height, label) = (side("width"), side("height"), escape(label));
    // Remove the background. Colours occur only in attributes: text has no quotation marks.
    let bare = rest.replacen("<rect width=\"100%\" height=\"100%\" fill=\"white\" />", "", 1);
    let inked = INKS.iter().fold(bare, |svg, (colour, variable)| {
        let upper = colour.to_uppercase();
        [*colour, &upper]
            .iter()
            .fold(svg, |svg, colour| svg.replace(&format!("\"{colour}\""), &format!("\"var(--{variable})\"")))
    });
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"drawing\" viewBox=\"0 0 {width} {height}\" fill=\"var(--ink)\" role=\"img\" aria-label=\"{label}\">{inked}"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_document_has_the_style_and_lets_nothing_in() {
        let page = document("A<b", "First.", "more", &card("Charts & tables", "<p>x</p>"));
        for part in [
            "<title>foveate: A&lt;b</title>",
            "<h1>A&lt;b</h1>",
            STYLE,
            "default-src 'none'",
            "<h2>Charts &amp; tables</h2>\n<p>x</p>",
        ] {
            assert!(page.contains(part), "{part}");
        }
        assert!(!page.contains("{{") && !page.contains("<script"));
    }

    #[test]
    fn a_drawing_takes_the_colours_of_the_page() {
        let svg = "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"120\" height=\"40.5\" fill=\"black\"><rect width=\"100%\" height=\"100%\" fill=\"white\" /><rect fill=\"white\" stroke=\"#0072B2\"/><text fill=\"#000000\">white</text></svg>";
        let drawn = drawing(svg, "A \"chart\"");
        assert!(drawn.contains("viewBox=\"0 0 120 40.5\"") && drawn.contains("aria-label=\"A &quot;chart&quot;\""));
        assert!(
            drawn.contains("fill=\"var(--ink)\" role") && !drawn.contains("100%"),
            "text without a colour, and the ground: {drawn}"
        );
        assert!(drawn.contains("<rect fill=\"var(--card)\" stroke=\"var(--target)\"/>"), "{drawn}");
        assert!(drawn.contains("<text fill=\"var(--ink)\">white</text>"), "text stays: {drawn}");
        for (_, variable) in INKS {
            assert_eq!(STYLE.matches(&format!("--{variable}:")).count(), 2, "{variable}: light and dark");
        }
    }
}
