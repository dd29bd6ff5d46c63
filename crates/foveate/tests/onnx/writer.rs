//! Small networks as ONNX files, written byte by byte (protobuf), so that no reader's own writer is trusted.
//!
//! A message is a run of fields: a key (field number and wire type), then a number in groups of 7 bits, or a length and bytes.

/// A message in the making.
#[derive(Clone, Default)]
struct Message(Vec<u8>);

impl Message {
    fn varint(&mut self, mut value: u64) {
        while value >= 128 {
            self.0.push(value as u8 | 128);
            value >>= 7;
        }
        self.0.push(value as u8);
    }
    fn int(mut self, field: u64, value: i64) -> Self {
        self.varint(field << 3);
        self.varint(value as u64);
        self
    }
    fn float(mut self, field: u64, value: f32) -> Self {
        self.varint(field << 3 | 5);
        self.0.extend(value.to_le_bytes());
        self
    }
    fn bytes(mut self, field: u64, bytes: &[u8]) -> Self {
        self.varint(field << 3 | 2);
        self.varint(bytes.len() as u64);
        self.0.extend_from_slice(bytes);
        self
    }
    fn text(self, field: u64, text: &str) -> Self {
        self.bytes(field, text.as_bytes())
    }
    fn message(self, field: u64, message: &Message) -> Self {
        self.bytes(field, &message.0)
    }
}

/// The attributes of an operator.
pub(crate) enum Attribute<'a> {
    Int(&'a str, i64),
    Ints(&'a str, &'a [i64]),
    Float(&'a str, f32),
}

impl Attribute<'_> {
    fn message(&self) -> Message {
        let named = |name: &str| Message::default().text(1, name);
        match *self {
            Attribute::Int(name, value) => named(name).int(3, value).int(20, 2),
            Attribute::Ints(name, values) => values.iter().fold(named(name), |m, v| m.int(8, *v)).int(20, 7),
            Attribute::Float(name, value) => named(name).float(2, value).int(20, 1),
        }
    }
}

/// Sides of an input or output; 0 for an open one.
pub(crate) type Sides<'a> = &'a [i64];

/// A graph with one input `x` and one output `y`.
pub(crate) struct Network {
    graph: Message,
}

fn value(name: &str, kind: i64, sides: Sides<'_>) -> Message {
    let shape = sides.iter().fold(Message::default(), |shape, side| {
        let dim = match side {
            0 => Message::default().text(2, "N"),
            side => Message::default().int(1, *side),
        };
        shape.message(1, &dim)
    });
    let tensor = Message::default().int(1, kind).message(2, &shape);
    Message::default().text(1, name).message(2, &Message::default().message(1, &tensor))
}

const FLOAT: i64 = 1;
const INT64: i64 = 7;

impl Network {
    /// With an input of these sides and an output of these, of 32-bit numbers.
    pub(crate) fn new(input: Sides<'_>, output: Sides<'_>) -> Self {
        Self::of(FLOAT, input, output)
    }
    /// With an input of another kind of numbers.
    pub(crate) fn of(kind: i64, input: Sides<'_>, output: Sides<'_>) -> Self {
        let graph = Message::default().text(2, "test");
        let graph = graph.message(11, &value("x", kind, input)).message(12, &value("y", FLOAT, output));
        Self { graph }
    }
    /// An operator from named inputs to one named output.
    pub(crate) fn node(mut self, op: &str, inputs: &[&str], output: &str, attributes: &[Attribute<'_>]) -> Self {
        let node = inputs.iter().fold(Message::default(), |node, input| node.text(1, input));
        let node = node.text(2, output).text(3, output).text(4, op);
        let node = attributes.iter().fold(node, |node, a| node.message(5, &a.message()));
        self.graph = self.graph.message(1, &node);
        self
    }
    /// Numbers of these sides, by name.
    pub(crate) fn floats(mut self, name: &str, sides: Sides<'_>, values: &[f32]) -> Self {
        let raw: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.graph = self.graph.message(5, &tensor(name, FLOAT, sides, &raw));
        self
    }
    /// Whole numbers of these sides, by name.
    pub(crate) fn ints(mut self, name: &str, sides: Sides<'_>, values: &[i64]) -> Self {
        let raw: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.graph = self.graph.message(5, &tensor(name, INT64, sides, &raw));
        self
    }
    /// The file.
    pub(crate) fn file(&self) -> Vec<u8> {
        let opset = Message::default().text(1, "").int(2, 17);
        Message::default().int(1, 8).text(2, "foveate tests").message(7, &self.graph).message(8, &opset).0
    }
}

fn tensor(name: &str, kind: i64, sides: Sides<'_>, raw: &[u8]) -> Message {
    let tensor = sides.iter().fold(Message::default(), |tensor, side| tensor.int(1, *side));
    tensor.int(2, kind).text(8, name).bytes(9, raw)
}
