//! The generated reference of docs/configuration.md: every key with its default and range.

use foveate::config::Config;
use foveate::files::Nowhere;
use toml::{Table, Value};

use super::sources::{Body, Field, Item, Variant, items, resolve};

/// The smallest valid configuration.
const LEAST: &str = r#"
particles = 100
dynamics = { kind = "autoregressive" }
retina = { kind = "foveal", side = 16, rings = [[18, 1]] }
encoder = { kind = "raw" }
likelihood = { distance = "cosine", sharpness = 1.0 }
policy = { kind = "fixed" }
"#;

/// The purpose of a section, and when to change it: the first words of its reference.
const INTRODUCTIONS: [(&str, &str); 23] = [
    ("resampling", "The selection step of the particle filter."),
    (
        "dynamics",
        "The motion model p(xₜ | xₜ₋₁). Raise `velocity` and `position` for targets that jerk. Set `log_scale` or `angle` to 0 if size or \
         angle never changes.",
    ),
    ("proposal", "The distribution that particles are drawn from: the motion model, or detections for some of them."),
    (
        "detection_likelihood",
        "Weights particles by p(detections | xₜ). Use it for detections that are known to belong to the target.",
    ),
    (
        "camera_motion",
        "Moves particles with the estimated motion of the camera before the motion model. For moving cameras.",
    ),
    (
        "detector",
        "A detector that runs once a frame. It feeds `[proposal]` and `[detection_likelihood]` and starts the tracks of many targets. \
         Detections of your own replace it.",
    ),
    ("start", "The spread of the first particles about the given box, p(x₀)."),
    (
        "retina",
        "The cells that are read about a gaze: concentric windows, from fine to coarse. An encoder with learned weights brings the retina \
         of its training.",
    ),
    (
        "encoder",
        "The features of a glimpse. Use `oriented` for real video and `raw` for digits; `onnx` is described in [onnx.md](onnx.md).",
    ),
    (
        "likelihood",
        "p(hₜ | xₜ, aₜ) = exp(−sharpness × distance), between the features of a particle and those of the template.",
    ),
    ("discriminant", "A ridge regression that learns, while tracking, to separate the target from its surroundings."),
    (
        "colour",
        "Colour histograms of the target and of its surroundings, updated while tracking. For targets that deform. The more alike the two \
         are, the smaller the weight.",
    ),
    (
        "box_regression",
        "A small convolutional network that moves the reported box to the target's borders. Its estimate of presence is a cue of P(lost) \
         (`[confidence]`).",
    ),
    (
        "distractors",
        "Searches every frame for places near the target that look like it, and learns them as background. It needs `[discriminant]`. \
         Lengths are in template units.",
    ),
    (
        "sensor",
        "The values that are read of each frame, for a camera with region read-out or tiles of a large picture. A window is \
         `[reach, values]`: half its side in template units, and the most values along a side in each plane.",
    ),
    (
        "policy",
        "The gazes that are scored in a frame. Keep `fixed` for real video; learned policies are for windows that are small beside the target.",
    ),
    ("reward", "The reward of a learned policy."),
    ("consistency", "Compares the evidence of each frame with the likelihoods of frame 1, on the target and off it."),
    (
        "confidence",
        "P(lost) = 1 / (1 + exp(−b − Σ wₖ cₖ)) with the [cues](confidence.md#cues) cₖ, and the rules of search and status. The \
         *own* P(lost) is that without the second tracker. Fit it with `foveate train confidence` after a change of likelihood, encoder or \
         dynamics.",
    ),
    ("recogniser", "Reports the class of the target. Without `alarm` it changes no track."),
    ("redetection", "Searches the whole picture for a lost target. Lengths are in template units."),
    (
        "local_search",
        "Finds a target that leaps farther than the particles reach, in the same frame, among the places near the estimate. It needs \
         `[distractors]`. Lengths are in template units.",
    ),
    (
        "multi_target",
        "Data association, initiation, termination, re-identification and occlusion of many targets. Distances are in half sides of \
         the target's box.",
    ),
];

/// Every section and every key.
pub(crate) fn reference(folders: &[&std::path::Path]) -> String {
    let items = items(folders);
    let config = resolve(&items, "schema::Config").expect("the struct of configurations");
    let Body::Struct(fields) = &config.body else { panic!("Config is a struct") };
    let mut out = String::from("### Top level\n\n");
    let (plain, sections): (Vec<&Field>, Vec<&Field>) = fields.iter().partition(|f| resolve(&items, &f.kind).is_none());
    let top = Part { items: &items, path: vec![], given: parse(LEAST) };
    out += &list(&plain.iter().flat_map(|field| top.rows(field, "")).collect::<Vec<_>>());
    let written = parse(&Config::parse(LEAST, "least").expect("it is enough").to_toml());
    for field in sections {
        let item = resolve(&items, &field.kind).expect("it is a section");
        let presence = match (field.required, field.optional, written.get(&field.name)) {
            (true, ..) => "Required.".into(),
            (_, true, _) => "Optional, off by default.".into(),
            (_, _, Some(value)) if item.tagged => format!("Optional, `{value}` by default."),
            _ => "Optional.".into(),
        };
        let introduction = INTRODUCTIONS.iter().find(|(name, _)| *name == field.name).map(|(_, text)| *text);
        let introduction = introduction.map_or_else(|| sentence(&field.docs), str::to_owned);
        out += &format!("\n### `[{}]`\n\n{introduction} {presence}\n", field.name);
        out += &section(&items, &field.name, item);
    }
    out
}

fn section(items: &[Item], name: &str, item: &Item) -> String {
    let given = |part: Table| {
        let mut whole = parse(LEAST);
        whole.insert(name.to_owned(), Value::Table(part));
        whole
    };
    match &item.body {
        Body::Struct(fields) => {
            let part = Part { items, path: vec![name.into()], given: given(dummies(items, fields)) };
            format!("\n{}", part.list(fields))
        }
        Body::Enum(variants) => {
            let (mut out, mut message, mut shown) = (String::new(), vec![], vec![]);
            for variant in variants {
                let fields = match &variant.holds {
                    Some(kind) => match &resolve(items, kind).expect("a struct of settings").body {
                        Body::Struct(fields) => fields,
                        Body::Enum(_) => panic!("{kind} is an enum within an enum"),
                    },
                    None => &variant.fields,
                };
                let mut dummy = dummies(items, fields);
                dummy.insert("kind".into(), Value::String(variant.name.clone()));
                let part = Part { items, path: vec![name.into()], given: given(dummy) };
                out += &format!("\n**`kind = \"{}\"`**: {}\n", variant.name, sentence(&variant.docs));
                let rows = fields.iter().flat_map(|field| part.rows(field, ""));
                let (again, new): (Vec<Row>, Vec<Row>) = rows.partition(|row| shown.contains(row));
                if !again.is_empty() {
                    let keys: Vec<&str> = again.iter().map(|row| row[0].as_str()).collect();
                    out += &format!("Also {}, as above.\n", keys.join(", "));
                }
                if !new.is_empty() {
                    out += &format!("\n{}", list(&new));
                }
                shown.extend(new);
                for field in fields.iter().filter(|field| !message.contains(&field.kind)).collect::<Vec<_>>() {
                    out += &part.words(field);
                    message.push(field.kind.clone());
                }
            }
            out
        }
    }
}

/// Values for required keys.
fn dummies(items: &[Item], fields: &[Field]) -> Table {
    let value = |field: &Field| match field.kind.as_str() {
        "String" => Value::String("FILE".into()),
        "f64" | "f32" | "Schedule" => Value::Float(1.0),
        "Vec<[usize; 2]>" => Value::Array(vec![Value::Array(vec![Value::Integer(8), Value::Integer(1)])]),
        "PolicyConfig" => Value::Table(parse("kind = \"fixed\"")),
        "distance::Kind" => Value::String("cosine".into()),
        kind => panic!("{}: write a value for {kind} in tests/documents/configuration.rs", field.name),
    };
    let mut all: Table = fields.iter().filter(|f| f.required).map(|f| (f.name.clone(), value(f))).collect();
    // The one rule between two keys: a sharpness or a rule for it.
    if fields.iter().any(|f| f.name == "sharpness") && items.iter().any(|i| i.name == "LikelihoodConfig") {
        all.insert("sharpness".into(), Value::Float(1.0));
    }
    all
}

/// A place in a configuration, and a configuration that has it.
struct Part<'a> {
    items: &'a [Item],
    path: Vec<String>,
    given: Table,
}

/// Key, type with range, default, meaning.
type Row = [String; 4];

impl Part<'_> {
    /// The lines of some fields, and the meaning of their words.
    fn list(&self, fields: &[Field]) -> String {
        let rows: Vec<Row> = fields.iter().flat_map(|field| self.rows(field, "")).collect();
        let mut out = list(&rows);
        for field in fields {
            out += &self.words(field);
        }
        out
    }

    /// A row for a key, or one for each key of the section that it is.
    fn rows(&self, field: &Field, prefix: &str) -> Vec<Row> {
        let key = format!("{prefix}{}", field.name);
        let item = resolve(self.items, &field.kind);
        if let Some(Item { body: Body::Struct(fields), .. }) = item {
            let own = field.optional.then(|| self.row(&key, field, "section"));
            let inner = fields.iter().flat_map(|inner| self.rows(inner, &format!("{key}.")));
            return own.into_iter().chain(inner).collect();
        }
        let kind = match (field.kind.as_str(), item) {
            (_, Some(Item { tagged: true, name, .. })) => {
                format!("{} section", name.trim_end_matches("Config").to_lowercase())
            }
            (_, Some(Item { body: Body::Enum(variants), .. })) => {
                variants.iter().map(spelled).collect::<Vec<_>>().join(", ")
            }
            ("f64" | "f32", _) => "number".into(),
            ("usize" | "u64", _) => "integer".into(),
            ("bool", _) => "boolean".into(),
            ("String", _) => "text".into(),
            ("Schedule", _) => "number, `\"anytime\"` or `{ frames = 300 }`".into(),
            ("[f64; OWN]", _) => format!("{} numbers", foveate_core::control::OWN),
            ("OwnPart", _) => "section of your own component".into(),
            ("Vec<f32>", _) => "list of numbers".into(),
            ("Vec<usize>", _) => "list of integers".into(),
            ("Patch", _) => "`[reach, values]`".into(),
            ("Vec<Patch>", _) => "list of `[reach, values]`".into(),
            ("Vec<[usize; 2]>", _) => "list of `[window, cell]`".into(),
            (kind, _) => panic!("{key}: say what a {kind} is in tests/documents/configuration.rs"),
        };
        vec![self.row(&key, field, &kind)]
    }

    fn row(&self, key: &str, field: &Field, kind: &str) -> Row {
        let default = match self.default(key) {
            _ if field.required => "required".into(),
            Some(value) => format!("`{value}`"),
            None if kind == "boolean" => "`false`".into(),
            None => "optional".into(),
        };
        let range =
            if ["number", "integer"].iter().any(|k| kind.starts_with(k)) { self.range(key, &field.kind) } else { None };
        let docs = sentence(&field.docs);
        let (kind, docs) = match range {
            Some(range) => {
                let docs = without_range(&docs, &range);
                (format!("{kind}, {range}"), docs)
            }
            None => (kind.into(), docs),
        };
        [format!("`{key}`"), kind, default, docs]
    }

    /// The default of a key: the configuration read, and written out.
    fn default(&self, key: &str) -> Option<Value> {
        let path: Vec<&str> = self.path.iter().map(String::as_str).chain(key.split('.')).collect();
        let find = |whole: Table| {
            let mut value = &Value::Table(whole);
            for part in &path {
                value = value.get(part)?;
            }
            Some(value.clone())
        };
        if self.path.len() == 1 && find(self.given.clone()).is_some() {
            return None;
        }
        let text = toml::to_string(&self.given).expect("a table");
        let config = Config::parse(&text, "given").unwrap_or_else(|e| panic!("{text}: {e}"));
        find(parse(&config.to_toml()))
    }

    /// The range that the library's own error names for a number that is far out of it. Every number refuses NaN.
    fn range(&self, key: &str, kind: &str) -> Option<String> {
        let far: &[Value] = match kind {
            "usize" | "u64" => &[Value::Integer(1 << 60), Value::Integer(0)],
            _ => {
                let error = self.error(key, Value::Float(f64::NAN)).unwrap_or_else(|| panic!("{key} accepts NaN"));
                assert!(key.split('.').any(|part| error.contains(part)), "{key}: {error}");
                &[Value::Float(-1e12), Value::Float(1e12)]
            }
        };
        far.iter().find_map(|value| interval(&self.error(key, value.clone())?))
    }

    /// The error of a configuration in which the key has this value.
    fn error(&self, key: &str, value: Value) -> Option<String> {
        let mut whole = self.given.clone();
        let mut table = &mut whole;
        let path: Vec<&str> = self.path.iter().map(String::as_str).chain(key.split('.')).collect();
        let (last, path) = path.split_last().expect("a key");
        for part in path {
            let inner = table.entry(*part).or_insert_with(|| Value::Table(Table::new()));
            table = inner.as_table_mut()?;
        }
        table.insert((*last).into(), value);
        let read = Config::parse(&toml::to_string(&whole).expect("a table"), "given");
        Some(read.and_then(|config| config.check(&Nowhere)).err()?.to_string())
    }

    /// The meanings of the words of an enum.
    fn words(&self, field: &Field) -> String {
        match resolve(self.items, &field.kind) {
            Some(Item { body: Body::Enum(variants), tagged: false, .. }) => {
                let mut out = format!("\nValues of `{}`:\n\n", field.name);
                for variant in variants {
                    let inner = variant.fields.iter().map(|f| format!(" `{}`: {}", f.name, sentence(&f.docs)));
                    out +=
                        &format!("- {}: {}{}\n", spelled(variant), sentence(&variant.docs), inner.collect::<String>());
                }
                out
            }
            _ => String::new(),
        }
    }
}

/// The text without the range that the line has already: `, 0.001 to 1` or `, above 0 to 1` before a full stop, colon, comma or semicolon.
fn without_range(docs: &str, range: &str) -> String {
    let (least, most) = range.trim_start_matches("above ").split_once(" to ").expect("a range has two ends");
    let above = format!("above 0 to {most}");
    let open = least.parse().is_ok_and(|least: f64| least <= 1e-3) && least != "0";
    let spellings = [range, if open { &above } else { range }];
    let mut text = docs.to_owned();
    for (spelling, mark, end) in spellings
        .iter()
        .flat_map(|s| [",", ";"].map(|mark| (s, mark)))
        .flat_map(|(s, mark)| [".", ":", ",", ";"].map(|end| (s, mark, end)))
    {
        text = text.replacen(&format!("{mark} {spelling}{end}"), end, 1);
    }
    text
}

/// A variant as a configuration has it.
fn spelled(variant: &Variant) -> String {
    if variant.fields.is_empty() {
        return format!("`\"{}\"`", variant.name);
    }
    let fields: Vec<String> = variant.fields.iter().map(|f| format!("{} = …", f.name)).collect();
    format!("`{{ {} = {{ {} }} }}`", variant.name, fields.join(", "))
}

/// `A to B` in an error: two numbers about the word, and `above` or `below` if the error has them.
fn interval(error: &str) -> Option<String> {
    let words: Vec<&str> = error.split_whitespace().collect();
    let number = |word: &str| word.trim_end_matches([';', ',', ')', '.']).parse::<f64>().ok();
    (1..words.len()).filter(|at| words[*at] == "to").find_map(|to| {
        let least = number(words[to - 1])?;
        let above = if to > 1 && words[to - 2] == "above" { "above " } else { "" };
        let below = if words.get(to + 1) == Some(&"below") { "below " } else { "" };
        let most = number(words.get(to + 1 + usize::from(!below.is_empty()))?)?;
        Some(format!("{above}{} to {below}{}", short(least), short(most)))
    })
}

fn short(number: f64) -> String {
    if number != 0.0 && !(1e-3..1e6).contains(&number.abs()) { format!("{number:e}") } else { number.to_string() }
}

fn parse(text: &str) -> Table {
    text.parse().expect("TOML")
}

/// The text as a sentence.
fn sentence(docs: &str) -> String {
    if docs.is_empty() || docs.ends_with(['.', ':', '?']) { docs.to_owned() } else { format!("{docs}.") }
}

/// A line for each key: with its default as a configuration has it, and its range.
fn list(rows: &[Row]) -> String {
    let line = |[key, kind, default, docs]: &Row| {
        if ["required", "optional"].contains(&default.as_str()) {
            return format!("- {key} ({kind}, {default}): {docs}\n");
        }
        let (key, value) = (key.trim_matches('`'), default.trim_matches('`'));
        let range = ["number, ", "integer, "].iter().find_map(|number| kind.strip_prefix(number));
        let range = range.map_or_else(String::new, |range| format!(", {range}"));
        format!("- `{key} = {value}`{range}: {docs}\n")
    };
    rows.iter().map(line).collect()
}
