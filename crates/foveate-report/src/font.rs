//! A stroke font for labels on pictures: letters as lines and curves on a small grid, so they scale to any size.
//!
//! A glyph is strokes separated by spaces. A stroke is `-` (corners), `~` (smooth, open) or `o` (smooth, closed)
//! and points `xy`, x from 0 to 4, y from 0 (top of capitals) over 2 (top of small letters) and 6 (baseline) to 8.
//! Smooth strokes are quadratic B-splines of their points, drawn by Chaikin's corner cutting.

/// Height of capitals on the grid.
pub(super) const CAPITAL: f64 = 6.0;
/// Space between two letters on the grid.
const GAP: f64 = 2.0;
/// Advance of a blank on the grid.
const BLANK: f64 = 3.0;

const GLYPHS: &[(char, &str)] = &[
    ('0', "o004043460603"),
    ('1', "-022026 -0646"),
    ('2', "~0200404306 -0646"),
    ('3', "~0100404323 ~2343460605"),
    ('4', "-36300444"),
    ('5', "-400003 ~032242460605"),
    ('6', "o02424606 ~040030"),
    ('7', "-004016"),
    ('8', "o00404303 o03434606"),
    ('9', "o00404404 ~424616"),
    ('A', "-062046 -1434"),
    ('B', "-26060020 ~20404323 -2303 ~23434626"),
    ('C', "~41400003064645"),
    ('D', "-16060010 ~1040434616"),
    ('E', "-40000646 -0333"),
    ('F', "-400006 -0333"),
    ('G', "~41400003064644 -4424"),
    ('H', "-0006 -4046 -0343"),
    ('I', "-0006"),
    ('J', "~40460604"),
    ('K', "-0006 -400346"),
    ('L', "-000646"),
    ('M', "-0600234046"),
    ('N', "-06004640"),
    ('O', "o004043460603"),
    ('P', "-060020 ~20404323 -2303"),
    ('Q', "o004043460603 -2446"),
    ('R', "-060020 ~20404323 -2303 -2346"),
    ('S', "~4140000343460605"),
    ('T', "-0040 -2026"),
    ('U', "~000306464340"),
    ('V', "-002640"),
    ('W', "-0016223640"),
    ('X', "-0046 -4006"),
    ('Y', "-002340 -2326"),
    ('Z', "-00400646"),
    ('a', "o02323606 -3236"),
    ('b', "-0006 o02323606"),
    ('c', "~333202063635"),
    ('d', "o02323606 -3036"),
    ('e', "-0434 ~343202063635"),
    ('f', "~20101216 -0222"),
    ('g', "o02323606 -3236 ~36380807"),
    ('h', "-0006 ~04023236"),
    ('i', "-0206 -00"),
    ('j', "-1216 ~161808 -10"),
    ('k', "-0006 -320436"),
    ('l', "-0006"),
    ('m', "-0206 ~04022226 ~24224246"),
    ('n', "-0206 ~04023236"),
    ('o', "o02323606"),
    ('p', "-0208 o02323606"),
    ('q', "-3238 o02323606"),
    ('r', "-0206 ~040222"),
    ('s', "~320204343606"),
    ('t', "~10131626 -0222"),
    ('u', "~02063634 -3236"),
    ('v', "-022642"),
    ('w', "-0216233642"),
    ('x', "-0236 -3206"),
    ('y', "-0226 -4218"),
    ('z', "-02320636"),
    ('.', "-06"),
    (',', "-0607"),
    (':', "-03 -06"),
    ('-', "-0333"),
    ('+', "-0343 -2125"),
    ('=', "-0242 -0444"),
    ('/', "-0640"),
    ('%', "-0640 o00202202 o24444626"),
    ('(', "~10020416"),
    (')', "~00121406"),
    ('\'', "-0001"),
    ('_', "-0646"),
    ('?', "~010040432324 -26"),
    ('!', "-0004 -06"),
    ('\u{b7}', "-03"),
    ('\u{b0}', "o00202202"),
];
/// Drawn for letters missing from the font.
const UNKNOWN: &str = "-0040460600";

/// Returns a letter's strokes, in grid units, and its advance.
pub(super) fn glyph(letter: char) -> (Vec<Vec<(f64, f64)>>, f64) {
    if letter == ' ' {
        return (vec![], BLANK);
    }
    let code = GLYPHS.iter().find(|g| g.0 == letter).map_or(UNKNOWN, |g| g.1);
    let strokes: Vec<_> = code.split(' ').map(stroke).collect();
    let width = strokes.iter().flatten().map(|p| p.0).fold(0.0, f64::max);
    // Digits have equal widths, so that changing numbers do not jitter.
    (strokes, if letter.is_ascii_digit() { 4.0 } else { width } + GAP)
}

fn stroke(code: &str) -> Vec<(f64, f64)> {
    let (kind, digits) = code.as_bytes().split_first().expect("a stroke starts with its kind");
    let points: Vec<_> = digits.chunks_exact(2).map(|p| (f64::from(p[0] - b'0'), f64::from(p[1] - b'0'))).collect();
    match kind {
        b'-' => points,
        b'~' => (0..3).fold(points, |points, _| cut(&points, false)),
        _ => {
            let mut ring = (0..3).fold(points, |points, _| cut(&points, true));
            ring.push(ring[0]);
            ring
        }
    }
}

/// Applies Chaikin's corner cutting; an open line keeps its ends.
fn cut(points: &[(f64, f64)], closed: bool) -> Vec<(f64, f64)> {
    let mix = |a: (f64, f64), b: (f64, f64), t: f64| (a.0 + t * (b.0 - a.0), a.1 + t * (b.1 - a.1));
    let n = points.len();
    let edges = if closed { n } else { n - 1 };
    let mut out = Vec::with_capacity(2 * edges + 2);
    for i in 0..edges {
        let (a, b) = (points[i], points[(i + 1) % n]);
        out.push(if i == 0 && !closed { a } else { mix(a, b, 0.25) });
        out.push(if i + 1 == edges && !closed { b } else { mix(a, b, 0.75) });
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_letter_is_well_formed_and_stays_on_the_grid() {
        for (letter, _) in GLYPHS {
            let (strokes, advance) = glyph(*letter);
            assert!(!strokes.is_empty() && advance >= GAP, "{letter}");
            let on_grid = |&(x, y): &(f64, f64)| (0.0..=4.0).contains(&x) && (0.0..=8.0).contains(&y);
            assert!(strokes.iter().all(|s| !s.is_empty()) && strokes.iter().flatten().all(on_grid), "{letter}");
        }
        assert_eq!(glyph('é'), glyph('¬'), "unknown letters have one face");
    }

    #[test]
    fn smooth_closed_strokes_touch_the_middle_of_their_edges() {
        let (strokes, _) = glyph('8');
        let top = strokes[0].iter().map(|p| p.1).fold(f64::INFINITY, f64::min);
        let bottom = strokes[1].iter().map(|p| p.1).fold(0.0, f64::max);
        assert!(top.abs() < 0.05 && (bottom - CAPITAL).abs() < 0.05, "{top} {bottom}");
    }
}
