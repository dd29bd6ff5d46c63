//! Arrays of numbers as text, in saved trackers.

use base64::Engine as _;

/// Base64 of the bytes of f32, the least first.
pub(super) fn encode(values: &[f32]) -> String {
    let bytes: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
    base64::engine::general_purpose::STANDARD.encode(bytes)
}

/// The largest number that is taken: products of two, summed over all features and frames, are numbers still.
const MOST: f32 = 1e15;

/// What `encode` gave; `None` where it is not that, or a number is not finite, or beyond what sums of features come to.
pub(super) fn decode(text: &str) -> Option<Vec<f32>> {
    let bytes = base64::engine::general_purpose::STANDARD.decode(text).ok()?;
    let (values, rest) = bytes.as_chunks::<4>();
    let values: Vec<f32> = values.iter().map(|x| f32::from_le_bytes(*x)).collect();
    (rest.is_empty() && values.iter().all(|x| x.abs() <= MOST)).then_some(values)
}
