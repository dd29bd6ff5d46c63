//! A drawn film of a ball that falls from rest beside a metre rule.

/// Width and height of a frame, pixels.
pub const SIZE: [usize; 2] = [360, 360];
/// Number of frames.
pub const FRAMES: usize = 42;
/// Frames a second.
pub const RATE: f64 = 60.0;
/// Gravity, m/s².
pub const G: f64 = 9.81;
/// The upper and lower end of the rule, pixels from 0.
pub const RULE: [(f64, f64); 2] = [(60.0, 40.0), (60.0, 280.0)];
/// Length of the rule, metres.
pub const LENGTH: f64 = 2.0;
/// Radius of the ball, pixels.
const RADIUS: f64 = 13.0;

/// Returns the centre of the ball in frame `t` (from 0), pixels from 0.
pub fn centre(t: usize) -> (f64, f64) {
    let seconds = t as f64 / RATE;
    (200.0, 40.0 + 0.5 * G * seconds * seconds * (RULE[1].1 - RULE[0].1) / LENGTH)
}

/// Returns the box of the ball in frame `t`: left, top, width, height.
pub fn bbox(t: usize) -> [f64; 4] {
    let (x, y) = centre(t);
    [x - RADIUS + 0.5, y - RADIUS + 0.5, 2.0 * RADIUS, 2.0 * RADIUS]
}

/// Returns the pixels of frame `t`, in grey.
pub fn picture(t: usize) -> Vec<u8> {
    let ([width, height], (cx, cy)) = (SIZE, centre(t));
    // Of 4 x 4 pixels, which a video keeps.
    let noise = crate::noise(1, (width / 4) * (height / 4));
    let coarse: Vec<f64> = noise.map(|byte| 60.0 + f64::from(byte >> 3)).collect();
    let pixel = |i: usize| {
        let (x, y) = (i % width, i / width);
        let (dx, dy) = (x as f64 - cx, y as f64 - cy);
        let mut value = coarse[y / 4 * (width / 4) + x / 4];
        let on_rule = (x as f64 - RULE[0].0).abs() < 1.5 && (RULE[0].1..=RULE[1].1).contains(&(y as f64));
        let at_end = RULE.iter().any(|(a, b)| (x as f64 - a).abs() < 8.0 && (y as f64 - b).abs() < 0.6);
        if on_rule || at_end {
            value = 235.0;
        }
        // Dark and bright quarters; the edge covers its pixels in part.
        let share = (RADIUS + 0.5 - dx.hypot(dy)).clamp(0.0, 1.0);
        let shade = if (dx > 0.0) == (dy > 0.0) { 225.0 } else { 150.0 };
        (value + share * (shade - value)).round() as u8
    };
    (0..width * height).map(pixel).collect()
}
