//! Numbers with their nouns.

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
