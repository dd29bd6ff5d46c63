//! From values to types.

use std::ops::Range;
use std::slice;

use serde::Deserializer;
use serde::de::value::BorrowedStrDeserializer;
use serde::de::{
    DeserializeSeed, EnumAccess, Error as _, Expected, MapAccess, SeqAccess, Unexpected, VariantAccess, Visitor,
};

use super::{Entry, Node, Problem, Value};

impl Node {
    /// The error of a type that expects something else; not generic, as all of it that need not be.
    fn mismatch(&self, expected: &dyn Expected) -> Problem {
        let found = match &self.value {
            Value::Null => Unexpected::Other("null"),
            Value::Bool(b) => Unexpected::Bool(*b),
            Value::Signed(n) => Unexpected::Signed(*n),
            Value::Unsigned(n) => Unexpected::Unsigned(*n),
            Value::Float(x) => Unexpected::Float(*x),
            Value::Single(x) => Unexpected::Float((*x).into()),
            Value::Text(text) => Unexpected::Str(text),
            Value::List(_) => Unexpected::Seq,
            Value::Section(_) => Unexpected::Map,
        };
        Problem::invalid_type(found, expected).at(&self.place)
    }
    /// Hands a number to a visitor of numbers.
    fn number<'de, V: Visitor<'de>>(&self, visitor: V) -> Result<V::Value, Problem> {
        let read = match self.value {
            Value::Signed(n) => visitor.visit_i64(n),
            Value::Unsigned(n) => visitor.visit_u64(n),
            Value::Float(x) => visitor.visit_f64(x),
            Value::Single(x) => visitor.visit_f32(x),
            _ => return Err(self.mismatch(&visitor)),
        };
        read.map_err(|problem: Problem| problem.at(&self.place))
    }
}

/// Methods that do the same as another one, with the arguments that they receive and do not need.
macro_rules! forward {
    ($($($method:ident)* => $to:ident $rest:tt;)*) => {$($( forward!(@ $method $to $rest); )*)*};
    (@ $method:ident $to:ident ($($rest:tt)*)) => {
        fn $method<V: Visitor<'de>>(self, $($rest)* visitor: V) -> Result<V::Value, Problem> {
            self.$to(visitor)
        }
    };
}

/// Each method calls no more of the visitor than a type of its kind can use: what could be called is compiled.
impl<'de> Deserializer<'de> for &'de Node {
    type Error = Problem;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Problem> {
        match &self.value {
            Value::Null => visitor.visit_unit().map_err(|problem: Problem| problem.at(&self.place)),
            Value::Bool(_) => self.deserialize_bool(visitor),
            Value::Text(_) => self.deserialize_str(visitor),
            Value::List(_) => self.deserialize_seq(visitor),
            Value::Section(_) => self.deserialize_map(visitor),
            _ => self.number(visitor),
        }
    }
    fn deserialize_bool<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Problem> {
        let Value::Bool(b) = self.value else { return Err(self.mismatch(&visitor)) };
        visitor.visit_bool(b).map_err(|problem: Problem| problem.at(&self.place))
    }
    fn deserialize_str<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Problem> {
        let Value::Text(text) = &self.value else { return Err(self.mismatch(&visitor)) };
        visitor.visit_borrowed_str(text).map_err(|problem: Problem| problem.at(&self.place))
    }
    fn deserialize_seq<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Problem> {
        let Value::List(items) = &self.value else { return Err(self.mismatch(&visitor)) };
        visitor.visit_seq(Items(items.iter())).map_err(|problem| problem.at(&self.place))
    }
    fn deserialize_map<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Problem> {
        let Value::Section(entries) = &self.value else { return Err(self.mismatch(&visitor)) };
        visitor.visit_map(Entries(entries.iter(), None)).map_err(|problem| problem.at(&self.place))
    }
    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Problem> {
        if self.value == Value::Null { visitor.visit_none() } else { visitor.visit_some(self) }
    }
    fn deserialize_unit<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Problem> {
        if self.value == Value::Null { visitor.visit_unit() } else { Err(self.mismatch(&visitor)) }
    }
    fn deserialize_newtype_struct<V: Visitor<'de>>(self, _: &'static str, visitor: V) -> Result<V::Value, Problem> {
        visitor.visit_newtype_struct(self)
    }
    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _: &'static str,
        _: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Problem> {
        let variant = match &self.value {
            Value::Text(name) => Variant { name, place: &self.place, node: None },
            Value::Section(entries) if entries.len() == 1 => {
                Variant { name: &entries[0].key, place: &entries[0].place, node: Some(&entries[0].node) }
            }
            _ => return Err(Problem::custom("wanted string or table").at(&self.place)),
        };
        visitor.visit_enum(variant).map_err(|problem| problem.at(&self.place))
    }
    fn deserialize_ignored_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Problem> {
        visitor.visit_unit()
    }
    forward! {
        deserialize_i8 deserialize_i16 deserialize_i32 deserialize_i64 => number();
        deserialize_u8 deserialize_u16 deserialize_u32 deserialize_u64 deserialize_f32 deserialize_f64 => number();
        deserialize_char deserialize_string deserialize_identifier => deserialize_str();
        deserialize_bytes deserialize_byte_buf => deserialize_seq();
        deserialize_tuple => deserialize_seq(_: usize,);
        deserialize_tuple_struct => deserialize_seq(_: &'static str, _: usize,);
        deserialize_struct => deserialize_map(_: &'static str, _: &'static [&'static str],);
        deserialize_unit_struct => deserialize_unit(_: &'static str,);
    }
}

struct Items<'de>(slice::Iter<'de, Node>);

impl<'de> SeqAccess<'de> for Items<'de> {
    type Error = Problem;
    fn next_element_seed<T: DeserializeSeed<'de>>(&mut self, seed: T) -> Result<Option<T::Value>, Problem> {
        self.0.next().map(|item| seed.deserialize(item)).transpose()
    }
    fn size_hint(&self) -> Option<usize> {
        Some(self.0.len())
    }
}

/// The entries that are left, and the value of the last key.
struct Entries<'de>(slice::Iter<'de, Entry>, Option<&'de Node>);

impl<'de> MapAccess<'de> for Entries<'de> {
    type Error = Problem;
    fn next_key_seed<K: DeserializeSeed<'de>>(&mut self, seed: K) -> Result<Option<K::Value>, Problem> {
        let Some(entry) = self.0.next() else { return Ok(None) };
        self.1 = Some(&entry.node);
        seed.deserialize(Key(&entry.key)).map(Some).map_err(|problem| problem.at(&entry.place))
    }
    fn next_value_seed<T: DeserializeSeed<'de>>(&mut self, seed: T) -> Result<T::Value, Problem> {
        let node = self.1.take().expect("its key was read");
        seed.deserialize(node).map_err(|problem| problem.at(&node.place))
    }
    fn size_hint(&self) -> Option<usize> {
        Some(self.0.len())
    }
}

/// A key, which may be that of a map by numbers.
struct Key<'de>(&'de str);

impl Key<'_> {
    fn number<'de, V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Problem> {
        let number = self.0.parse().map(Value::Signed).or_else(|_| self.0.parse().map(Value::Unsigned));
        Node::from(number.unwrap_or_else(|_| Value::Text(self.0.into()))).number(visitor)
    }
}

impl<'de> Deserializer<'de> for Key<'de> {
    type Error = Problem;
    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Problem> {
        visitor.visit_borrowed_str(self.0)
    }
    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Problem> {
        visitor.visit_some(self)
    }
    fn deserialize_newtype_struct<V: Visitor<'de>>(self, _: &'static str, visitor: V) -> Result<V::Value, Problem> {
        visitor.visit_newtype_struct(self)
    }
    fn deserialize_enum<V: Visitor<'de>>(
        self,
        name: &'static str,
        variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Problem> {
        BorrowedStrDeserializer::new(self.0).deserialize_enum(name, variants, visitor)
    }
    forward! {
        deserialize_i8 deserialize_i16 deserialize_i32 deserialize_i64 => number();
        deserialize_u8 deserialize_u16 deserialize_u32 deserialize_u64 => number();
    }
    serde::forward_to_deserialize_any! {
        bool f32 f64 char str string bytes byte_buf unit unit_struct seq tuple tuple_struct map struct identifier ignored_any
    }
}

/// A variant by its name, and what belongs to it.
struct Variant<'de> {
    name: &'de str,
    place: &'de Range<usize>,
    node: Option<&'de Node>,
}

impl<'de> Variant<'de> {
    fn node(&self) -> Result<&'de Node, Problem> {
        self.node
            .ok_or_else(|| Problem::invalid_type(Unexpected::UnitVariant, &"a variant with a value").at(self.place))
    }
}

impl<'de> EnumAccess<'de> for Variant<'de> {
    type Error = Problem;
    type Variant = Self;
    fn variant_seed<T: DeserializeSeed<'de>>(self, seed: T) -> Result<(T::Value, Self), Problem> {
        let read = seed.deserialize(BorrowedStrDeserializer::<Problem>::new(self.name));
        read.map_err(|problem| problem.at(self.place)).map(|variant| (variant, self))
    }
}

impl<'de> VariantAccess<'de> for Variant<'de> {
    type Error = Problem;
    fn unit_variant(self) -> Result<(), Problem> {
        self.node.map_or(Ok(()), |node| Err(node.mismatch(&"no value")))
    }
    fn newtype_variant_seed<T: DeserializeSeed<'de>>(self, seed: T) -> Result<T::Value, Problem> {
        seed.deserialize(self.node()?)
    }
    fn tuple_variant<V: Visitor<'de>>(self, _: usize, visitor: V) -> Result<V::Value, Problem> {
        self.node()?.deserialize_seq(visitor)
    }
    fn struct_variant<V: Visitor<'de>>(self, _: &'static [&'static str], visitor: V) -> Result<V::Value, Problem> {
        self.node()?.deserialize_map(visitor)
    }
}
