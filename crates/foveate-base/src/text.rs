//! Numbers with their nouns; names from strangers.

use std::borrow::Cow;

/// The text with control characters as visible escapes, line feeds and tabs included: a terminal or a viewer would execute those of a
/// name, and a line feed would end its line.
///
/// ```
/// assert_eq!(foveate_base::text::visible("a\u{1b}[31m\nb"), "a\\u{1b}[31m\\nb");
/// ```
pub fn visible(text: &str) -> Cow<'_, str> {
    visible_except(text, &[])
}

/// As [`visible`], with the control characters `kept` as they are: for texts of several lines.
pub fn visible_except<'a>(text: &'a str, kept: &[char]) -> Cow<'a, str> {
    let harms = |c: char| c.is_control() && !kept.contains(&c);
    match text.contains(harms) {
        false => text.into(),
        true => text.chars().map(|c| if harms(c) { c.escape_debug().to_string() } else { c.to_string() }).collect(),
    }
}

/// A count and its noun, which is given in the singular: "1 frame", "2 frames", "0 boxes". Regular plurals alone.
///
/// ```
/// use foveate_base::text::counted;
/// assert_eq!([counted(1, "box"), counted(2, "box"), counted(0, "frame")], ["1 box", "2 boxes", "0 frames"]);
/// ```
pub fn counted(n: usize, noun: &str) -> String {
    let hissing = ["s", "x", "ch", "sh"].iter().any(|end| noun.ends_with(end));
    let ending = match n {
        1 => "",
        _ if hissing => "es",
        _ => "s",
    };
    format!("{n} {noun}{ending}")
}
