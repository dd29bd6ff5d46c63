//! Values between text and the types that serde reads and writes. Settings pass through this one form, so that the code of serde for each
//! type is compiled once, not for each format and each of its readers.

use std::fmt;
use std::ops::Range;

use serde::de::{self, Deserialize, DeserializeOwned, Deserializer, MapAccess, SeqAccess, Visitor};
use serde::ser::{Serialize, SerializeMap, Serializer};
use toml::de::{DeTable, DeValue};

mod read;
mod write;

/// A value and its place in the text; a value that is not from a text is at 0.
#[derive(Clone, Debug, Default)]
pub(crate) struct Node {
    pub value: Value,
    place: Range<usize>,
}

#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) enum Value {
    #[default]
    Null,
    Bool(bool),
    Signed(i64),
    Unsigned(u64),
    Float(f64),
    /// Its text has fewer digits.
    Single(f32),
    Text(String),
    List(Vec<Node>),
    Section(Vec<Entry>),
}

impl Value {
    fn whole(n: u64) -> Self {
        n.try_into().map_or(Self::Unsigned(n), Self::Signed)
    }
}

/// A key of a section, its place in the text, and its value.
#[derive(Clone, Debug)]
pub(crate) struct Entry {
    pub key: String,
    place: Range<usize>,
    pub node: Node,
}

/// The places make no difference.
impl PartialEq for Node {
    fn eq(&self, other: &Self) -> bool {
        self.value == other.value
    }
}

impl PartialEq for Entry {
    fn eq(&self, other: &Self) -> bool {
        (&self.key, &self.node) == (&other.key, &other.node)
    }
}

impl From<Value> for Node {
    fn from(value: Value) -> Self {
        Self { value, place: 0..0 }
    }
}

impl Entry {
    pub(crate) fn new(key: impl Into<String>, node: impl Into<Node>) -> Self {
        Self { key: key.into(), place: 0..0, node: node.into() }
    }
}

impl Node {
    /// Parses a document of TOML.
    pub(crate) fn parse(text: &str) -> Result<Self, String> {
        let table = DeTable::parse(text).map_err(|e| e.to_string())?;
        let place = table.span();
        let value = section(table.into_inner()).map_err(|problem| problem.shown(text))?;
        Ok(Self { value, place })
    }
    /// The value of a type of settings.
    pub(crate) fn of(settings: &impl Serialize) -> Self {
        settings.serialize(write::Writer).expect("settings are plain data")
    }
    /// Reads settings.
    pub(crate) fn read<T: DeserializeOwned>(&self) -> Result<T, Problem> {
        T::deserialize(self)
    }
    /// Reads settings from JSON.
    pub(crate) fn read_json<T: DeserializeOwned>(text: impl AsRef<[u8]>) -> Result<T, String> {
        let node: Self = serde_json::from_slice(text.as_ref()).map_err(|e| e.to_string())?;
        node.read().map_err(|e| e.to_string())
    }
    /// Formats it as a document of TOML.
    pub(crate) fn to_toml(&self) -> String {
        toml::to_string(self).expect("a section of plain data")
    }
    /// The same as it is after JSON: keys in order, one type of number, none that is not finite.
    pub(crate) fn into_json(mut self) -> Self {
        match &mut self.value {
            Value::Single(x) => self.value = Value::Float((*x).into()),
            Value::List(items) => items.iter_mut().for_each(|item| *item = std::mem::take(item).into_json()),
            Value::Section(entries) => {
                entries.sort_by(|a, b| a.key.cmp(&b.key));
                entries.iter_mut().for_each(|entry| entry.node = std::mem::take(&mut entry.node).into_json());
            }
            _ => {}
        }
        match self.value {
            Value::Float(x) if !x.is_finite() => Self::default(),
            _ => self,
        }
    }
    pub(crate) fn is_null(&self) -> bool {
        self.value == Value::Null
    }
    /// Returns the value of a key of a section.
    pub(crate) fn get(&self, key: &str) -> Option<&Self> {
        let Value::Section(entries) = &self.value else { return None };
        entries.iter().find(|entry| entry.key == key).map(|entry| &entry.node)
    }
    /// Returns the entries of a section.
    pub(crate) fn entries(&mut self) -> Option<&mut Vec<Entry>> {
        match &mut self.value {
            Value::Section(entries) => Some(entries),
            _ => None,
        }
    }
}

fn section(table: DeTable<'_>) -> Result<Value, Problem> {
    let entry = |(key, value): (toml::Spanned<std::borrow::Cow<'_, str>>, toml::Spanned<DeValue<'_>>)| {
        let place = key.span();
        Ok(Entry { key: key.into_inner().into_owned(), place, node: node(value)? })
    };
    Ok(Value::Section(table.into_iter().map(entry).collect::<Result<_, _>>()?))
}

fn node(value: toml::Spanned<DeValue<'_>>) -> Result<Node, Problem> {
    let place = value.span();
    let too_large = || <Problem as de::Error>::custom("the number is too large").at(&place);
    let value = match value.into_inner() {
        DeValue::String(text) => Value::Text(text.into_owned()),
        DeValue::Integer(n) => match i64::from_str_radix(n.as_str(), n.radix()) {
            Ok(n) => Value::Signed(n),
            Err(_) => Value::Unsigned(u64::from_str_radix(n.as_str(), n.radix()).map_err(|_| too_large())?),
        },
        DeValue::Float(x) => {
            let number = x.as_str().parse::<f64>().ok();
            Value::Float(number.filter(|n| n.is_finite() || !x.as_str().contains('e')).ok_or_else(too_large)?)
        }
        DeValue::Boolean(b) => Value::Bool(b),
        DeValue::Datetime(time) => Value::Text(time.to_string()),
        DeValue::Array(items) => Value::List(items.into_iter().map(node).collect::<Result<_, _>>()?),
        DeValue::Table(table) => section(table)?,
    };
    Ok(Node { value, place })
}

/// A value that does not fit a type: the reason, and its place in the text if it has one.
#[derive(Debug)]
pub(crate) struct Problem(Box<(String, Option<Range<usize>>)>);

impl Problem {
    /// Adds the place, unless it has a narrower one.
    fn at(mut self, place: &Range<usize>) -> Self {
        self.0.1.get_or_insert_with(|| place.clone());
        self
    }
    /// The reason.
    pub(crate) fn message(&self) -> &str {
        &self.0.0
    }
    /// Formats it with the line of the text, as errors of TOML's syntax.
    pub(crate) fn shown(&self, text: &str) -> String {
        let (message, Some(place)) = &*self.0 else { return format!("{}\n", self.0.0) };
        let before = &text[..text.floor_char_boundary(place.start)];
        let (line, start) = (before.matches('\n').count(), before.rfind('\n').map_or(0, |end| end + 1));
        let content = text[start..].split('\n').next().unwrap_or("");
        let column = before[start..].chars().count();
        let marked = place.len().min(content.len().saturating_sub(column)).max(1);
        let number = (line + 1).to_string();
        let margin = " ".repeat(number.len() + 1);
        format!(
            "TOML parse error at line {number}, column {}\n{margin}|\n{number} | {content}\n{margin}|{}{}\n{message}\n",
            column + 1,
            " ".repeat(column + 1),
            "^".repeat(marked),
        )
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.message())
    }
}

impl std::error::Error for Problem {}

impl de::Error for Problem {
    fn custom<T: fmt::Display>(message: T) -> Self {
        Self(Box::new((message.to_string(), None)))
    }
}

impl serde::ser::Error for Problem {
    fn custom<T: fmt::Display>(message: T) -> Self {
        de::Error::custom(message)
    }
}

/// In the formats that other crates write.
impl Serialize for Node {
    fn serialize<S: Serializer>(&self, s: S) -> Result<S::Ok, S::Error> {
        match &self.value {
            Value::Null => s.serialize_none(),
            Value::Bool(b) => s.serialize_bool(*b),
            Value::Signed(n) => s.serialize_i64(*n),
            Value::Unsigned(n) => s.serialize_u64(*n),
            Value::Float(x) => s.serialize_f64(*x),
            Value::Single(x) => s.serialize_f32(*x),
            Value::Text(text) => s.serialize_str(text),
            Value::List(items) => s.collect_seq(items),
            Value::Section(entries) => {
                let mut map = s.serialize_map(Some(entries.len()))?;
                for Entry { key, node, .. } in entries {
                    map.serialize_entry(key, node)?;
                }
                map.end()
            }
        }
    }
}

/// From the formats that other crates read.
impl<'de> Deserialize<'de> for Node {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        d.deserialize_any(Any)
    }
}

struct Any;

impl<'de> Visitor<'de> for Any {
    type Value = Node;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("any value")
    }
    fn visit_unit<E>(self) -> Result<Node, E> {
        Ok(Value::Null.into())
    }
    fn visit_none<E>(self) -> Result<Node, E> {
        Ok(Value::Null.into())
    }
    fn visit_some<D: Deserializer<'de>>(self, d: D) -> Result<Node, D::Error> {
        Node::deserialize(d)
    }
    fn visit_bool<E>(self, b: bool) -> Result<Node, E> {
        Ok(Value::Bool(b).into())
    }
    fn visit_i64<E>(self, n: i64) -> Result<Node, E> {
        Ok(Value::Signed(n).into())
    }
    fn visit_u64<E>(self, n: u64) -> Result<Node, E> {
        Ok(Value::whole(n).into())
    }
    fn visit_f64<E>(self, x: f64) -> Result<Node, E> {
        Ok(Value::Float(x).into())
    }
    fn visit_f32<E>(self, x: f32) -> Result<Node, E> {
        Ok(Value::Single(x).into())
    }
    fn visit_str<E>(self, text: &str) -> Result<Node, E> {
        Ok(Value::Text(text.into()).into())
    }
    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Node, A::Error> {
        let mut list = vec![];
        while let Some(item) = items.next_element()? {
            list.push(item);
        }
        Ok(Value::List(list).into())
    }
    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Node, A::Error> {
        let mut entries = vec![];
        while let Some((key, node)) = map.next_entry::<String, Node>()? {
            entries.push(Entry::new(key, node));
        }
        Ok(Value::Section(entries).into())
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    /// Every kind of value that settings have.
    #[derive(Debug, PartialEq, serde::Serialize, serde::Deserialize)]
    #[serde(deny_unknown_fields)]
    struct All {
        seed: u64,
        below: i8,
        half: f32,
        third: f64,
        whole: f64,
        on: bool,
        name: String,
        letter: char,
        pair: (usize, String),
        given: Option<u8>,
        #[serde(default)]
        missing: Option<u8>,
        kinds: Vec<Kind>,
        part: Part,
        parts: BTreeMap<String, Part>,
        none: Vec<Part>,
        rows: BTreeMap<u64, BTreeMap<Word, i8>>,
    }

    #[derive(Debug, PartialEq, serde::Serialize, serde::Deserialize)]
    #[serde(rename_all = "kebab-case")]
    enum Kind {
        OneWord,
        Number(f32),
        Two(u8, u8),
        Named { n: usize },
    }

    #[derive(Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize, serde::Deserialize)]
    enum Word {
        One,
    }

    #[derive(Debug, PartialEq, serde::Serialize, serde::Deserialize)]
    #[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
    enum Part {
        Empty,
        Full { n: usize, rows: Option<Inner> },
    }

    #[derive(Debug, PartialEq, serde::Serialize, serde::Deserialize)]
    struct Inner(Vec<f64>);

    fn all() -> All {
        let part = |n| Part::Full { n, rows: (n == 8).then(|| Inner(vec![0.5, -1e-9])) };
        All {
            seed: 1 << 40,
            below: -7,
            half: 0.1,
            third: 1.0 / 3.0,
            whole: 2.0,
            on: true,
            name: "ä \"b\"\n".into(),
            letter: 'z',
            pair: (3, "c".into()),
            given: Some(4),
            missing: None,
            kinds: vec![Kind::OneWord, Kind::Number(0.3), Kind::Two(1, 2), Kind::Named { n: 5 }],
            part: part(6),
            parts: [("a".into(), Part::Empty), ("b b".into(), part(8))].into(),
            none: vec![],
            rows: [(7, [(Word::One, -1)].into()), (u64::MAX, [].into())].into(),
        }
    }

    #[test]
    fn texts_are_those_of_each_format_without_the_tree() {
        let (all, node) = (all(), Node::of(&all()));
        assert_eq!(node.to_toml(), toml::to_string(&all).expect("plain data"));
        assert_eq!(serde_json::to_string(&node).ok(), serde_json::to_string(&all).ok());
        assert_eq!(serde_json::to_value(&node).ok(), serde_json::to_value(&all).ok());
        assert_eq!(node.read::<All>().expect("just written"), all);
        let parsed: Node =
            serde_json::from_str(&serde_json::to_value(&all).expect("plain data").to_string()).expect("JSON");
        assert_eq!(node.clone().into_json(), parsed);
        assert!(Node::of(&f32::NAN).into_json().is_null());
        assert_eq!(Node::parse(&node.to_toml()).expect("TOML").read::<All>().expect("just written"), all);
        assert_eq!(Node::read_json::<All>(serde_json::to_string(&all).expect("plain data")), Ok(all));
    }

    /// The error of TOML's own deserializer, with its place, wherever a value of a document is wrong.
    #[test]
    fn errors_are_those_of_toml_without_the_tree() {
        let right = Node::of(&all()).to_toml();
        let changes = [
            ("seed = 1099511627776", "seed = -1"),
            ("seed = 1099511627776", "seed = 1.5"),
            ("seed = 1099511627776", "sead = 3"),
            ("seed = 1099511627776", "seed = 3\nseed = 4"),
            ("seed = 1099511627776", "seed = 1\nä = 2"),
            ("seed = 1099511627776\n", ""),
            ("below = -7", "below = 200"),
            ("half = 0.1", "half = \"a\""),
            ("half = 0.1", "half = [1]"),
            ("on = true", "on = 3"),
            ("on = true", "on ="),
            ("letter = \"z\"", "letter = \"zz\""),
            ("name = ", "name = 3 #"),
            ("pair = [3, \"c\"]", "pair = [3]"),
            ("pair = [3, \"c\"]", "pair = { a = 3 }"),
            ("pair = [3, \"c\"]", "pair = [\"ö\", \"c\"]"),
            ("given = 4", "given = 400"),
            ("\"one-word\"", "\"one-ward\""),
            ("\"one-word\"", "{ numbor = 3 }"),
            ("\"one-word\"", "3"),
            ("number = 0.3", "number = \"a\""),
            ("named = { n = 5 }", "named = { n = true }"),
            ("n = 6", "n = 6\nm = 7"),
            ("n = 6", "m = 7"),
            ("n = 6", "n = [7]"),
            ("[part]\nkind = \"full\"", "[part]\nkind = \"fall\""),
            ("[part]\nkind = \"full\"", "[part]"),
            ("[part]\nkind = \"full\"\nn = 6", "[part]\nkind = 3"),
        ];
        for (old, new) in changes {
            assert!(right.contains(old), "{old} in {right}");
            let text = right.replacen(old, new, 1);
            let read = |text: &str| Node::parse(text)?.read::<All>().map_err(|problem| problem.shown(text));
            let expected = toml::from_str::<All>(&text).expect_err(new).to_string();
            assert_eq!(read(&text).expect_err(new), expected);
        }
    }

    #[test]
    fn numbers_that_no_type_holds_have_a_place() {
        for text in ["a = 99999999999999999999", "a = 1e999"] {
            let error = Node::parse(text).expect_err(text);
            assert!(error.contains("line 1, column 5") && error.contains("too large"), "{error}");
        }
        assert_eq!(
            Node::parse("a = [0xff, -inf, 1979-05-27]").map(|node| node.to_toml()).as_deref(),
            Ok("a = [255, -inf, \"1979-05-27\"]\n")
        );
    }
}
