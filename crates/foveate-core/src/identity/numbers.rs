//! Arrays of numbers as text, in saved trackers: base64 of their bytes, the least first. For `serde(with)`.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// The largest number that is taken: products of two, summed over all features and frames, are numbers still.
const MOST: f32 = 1e15;

/// Writes bytes.
fn serialize<S: Serializer>(bytes: &[u8], to: S) -> Result<S::Ok, S::Error> {
    to.serialize_str(&STANDARD.encode(bytes))
}

/// Reads bytes.
fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<u8>, D::Error> {
    STANDARD.decode(String::deserialize(from)?).map_err(D::Error::custom)
}

/// Signed bytes.
pub(super) mod codes {
    use super::*;

    pub(in super::super) fn serialize<S: Serializer>(codes: &[i8], to: S) -> Result<S::Ok, S::Error> {
        super::serialize(&codes.iter().map(|code| code.cast_unsigned()).collect::<Vec<_>>(), to)
    }

    pub(in super::super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<i8>, D::Error> {
        Ok(super::deserialize(from)?.into_iter().map(u8::cast_signed).collect())
    }
}

/// Numbers of type f32, which are finite and not larger than sums of features may become.
pub(super) mod floats {
    use super::*;

    pub(in super::super) fn serialize<S: Serializer>(values: &[f32], to: S) -> Result<S::Ok, S::Error> {
        super::serialize(&values.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<_>>(), to)
    }

    pub(in super::super) fn deserialize<'de, D: Deserializer<'de>, T: From<Vec<f32>>>(from: D) -> Result<T, D::Error> {
        let bytes = super::deserialize(from)?;
        let (values, rest) = bytes.as_chunks::<4>();
        let values: Vec<f32> = values.iter().map(|x| f32::from_le_bytes(*x)).collect();
        match rest.is_empty() && values.iter().all(|x| x.abs() <= MOST) {
            true => Ok(values.into()),
            false => Err(D::Error::custom("its numbers are not finite, or not base64 of them")),
        }
    }
}

/// A picture: its width, height and planes, and its bytes.
pub(super) mod picture {
    use super::*;
    use crate::scene::Image;

    pub(in super::super) fn serialize<S: Serializer>(image: &Image, to: S) -> Result<S::Ok, S::Error> {
        (image.shape(), STANDARD.encode(image.bytes())).serialize(to)
    }

    pub(in super::super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Image, D::Error> {
        let ([width, height, planes], bytes) = <([usize; 3], String)>::deserialize(from)?;
        let bytes = STANDARD.decode(bytes).map_err(D::Error::custom)?;
        Image::new(width, height, planes, bytes).map_err(D::Error::custom)
    }
}
