//! From types to values.

use serde::ser::{self, Serialize, Serializer};

use super::{Entry, Node, Problem, Value};

type Written = Result<Node, Problem>;

/// Makes the value of a type.
pub(super) struct Writer;

/// A list that is being written; of a variant, if it has a name.
pub(super) struct List(Vec<Node>, Option<&'static str>);

/// A section that is being written; of a variant, if it has a name.
pub(super) struct Section(Vec<Entry>, Option<&'static str>);

/// The value of a variant, under its name.
fn named(variant: Option<&str>, value: Value) -> Node {
    match variant {
        Some(name) => Value::Section(vec![Entry::new(name, value)]).into(),
        None => value.into(),
    }
}

macro_rules! plain {
    ($($method:ident($kind:ty) $make:expr;)*) => {$(
        fn $method(self, value: $kind) -> Written {
            let make: fn($kind) -> Value = $make;
            Ok(make(value).into())
        }
    )*};
}

impl Serializer for Writer {
    type Ok = Node;
    type Error = Problem;
    type SerializeSeq = List;
    type SerializeTuple = List;
    type SerializeTupleStruct = List;
    type SerializeTupleVariant = List;
    type SerializeMap = Section;
    type SerializeStruct = Section;
    type SerializeStructVariant = Section;

    plain! {
        serialize_bool(bool) Value::Bool;
        serialize_i8(i8) |n| Value::Signed(n.into());
        serialize_i16(i16) |n| Value::Signed(n.into());
        serialize_i32(i32) |n| Value::Signed(n.into());
        serialize_i64(i64) Value::Signed;
        serialize_u8(u8) |n| Value::Signed(n.into());
        serialize_u16(u16) |n| Value::Signed(n.into());
        serialize_u32(u32) |n| Value::Signed(n.into());
        serialize_u64(u64) Value::whole;
        serialize_f32(f32) Value::Single;
        serialize_f64(f64) Value::Float;
        serialize_char(char) |c| Value::Text(c.into());
        serialize_str(&str) |text| Value::Text(text.into());
        serialize_bytes(&[u8]) |bytes| Value::List(bytes.iter().map(|&b| Value::Signed(b.into()).into()).collect());
        serialize_unit_struct(&'static str) |_| Value::Null;
    }
    fn serialize_none(self) -> Written {
        Ok(Value::Null.into())
    }
    fn serialize_unit(self) -> Written {
        Ok(Value::Null.into())
    }
    fn serialize_some<T: Serialize + ?Sized>(self, value: &T) -> Written {
        value.serialize(self)
    }
    fn serialize_unit_variant(self, _: &'static str, _: u32, variant: &'static str) -> Written {
        self.serialize_str(variant)
    }
    fn serialize_newtype_struct<T: Serialize + ?Sized>(self, _: &'static str, value: &T) -> Written {
        value.serialize(self)
    }
    fn serialize_newtype_variant<T: Serialize + ?Sized>(
        self,
        _: &'static str,
        _: u32,
        variant: &'static str,
        value: &T,
    ) -> Written {
        Ok(named(Some(variant), value.serialize(self)?.value))
    }
    fn serialize_seq(self, _: Option<usize>) -> Result<List, Problem> {
        Ok(List(vec![], None))
    }
    fn serialize_tuple(self, _: usize) -> Result<List, Problem> {
        Ok(List(vec![], None))
    }
    fn serialize_tuple_struct(self, _: &'static str, _: usize) -> Result<List, Problem> {
        Ok(List(vec![], None))
    }
    fn serialize_tuple_variant(
        self,
        _: &'static str,
        _: u32,
        variant: &'static str,
        _: usize,
    ) -> Result<List, Problem> {
        Ok(List(vec![], Some(variant)))
    }
    fn serialize_map(self, _: Option<usize>) -> Result<Section, Problem> {
        Ok(Section(vec![], None))
    }
    fn serialize_struct(self, _: &'static str, _: usize) -> Result<Section, Problem> {
        Ok(Section(vec![], None))
    }
    fn serialize_struct_variant(
        self,
        _: &'static str,
        _: u32,
        variant: &'static str,
        _: usize,
    ) -> Result<Section, Problem> {
        Ok(Section(vec![], Some(variant)))
    }
}

macro_rules! lists {
    ($($kind:ident $push:ident;)*) => {$(
        impl ser::$kind for List {
            type Ok = Node;
            type Error = Problem;
            fn $push<T: Serialize + ?Sized>(&mut self, value: &T) -> Result<(), Problem> {
                self.0.push(value.serialize(Writer)?);
                Ok(())
            }
            fn end(self) -> Written {
                Ok(named(self.1, Value::List(self.0)))
            }
        }
    )*};
}

lists! {
    SerializeSeq serialize_element;
    SerializeTuple serialize_element;
    SerializeTupleStruct serialize_field;
    SerializeTupleVariant serialize_field;
}

macro_rules! sections {
    ($($kind:ident)*) => {$(
        impl ser::$kind for Section {
            type Ok = Node;
            type Error = Problem;
            fn serialize_field<T: Serialize + ?Sized>(&mut self, key: &'static str, value: &T) -> Result<(), Problem> {
                self.0.push(Entry::new(key, value.serialize(Writer)?));
                Ok(())
            }
            fn end(self) -> Written {
                Ok(named(self.1, Value::Section(self.0)))
            }
        }
    )*};
}

sections!(SerializeStruct SerializeStructVariant);

impl ser::SerializeMap for Section {
    type Ok = Node;
    type Error = Problem;
    fn serialize_key<T: Serialize + ?Sized>(&mut self, key: &T) -> Result<(), Problem> {
        let key = match key.serialize(Writer)?.value {
            Value::Text(key) => key,
            Value::Signed(n) => n.to_string(),
            Value::Unsigned(n) => n.to_string(),
            _ => return Err(ser::Error::custom("a key is text or a whole number")),
        };
        self.0.push(Entry::new(key, Value::Null));
        Ok(())
    }
    fn serialize_value<T: Serialize + ?Sized>(&mut self, value: &T) -> Result<(), Problem> {
        self.0.last_mut().expect("its key is written").node = value.serialize(Writer)?;
        Ok(())
    }
    fn end(self) -> Written {
        Ok(Value::Section(self.0).into())
    }
}
