//! What serde reads, as the sources have it: structs and enums that derive `Deserialize`, with their documentation.

use std::path::Path;

/// A struct or an enum.
pub(crate) struct Item {
    pub name: String,
    /// Its file.
    file: String,
    /// Returns whether a `kind` selects one of its variants.
    pub tagged: bool,
    pub body: Body,
}

pub(crate) enum Body {
    Struct(Vec<Field>),
    Enum(Vec<Variant>),
}

pub(crate) struct Field {
    pub name: String,
    /// Its type, without `Option`, `Box` and visibility.
    pub kind: String,
    pub docs: String,
    pub optional: bool,
    /// Whether it must be given.
    pub required: bool,
}

pub(crate) struct Variant {
    /// As a configuration has it.
    pub name: String,
    pub docs: String,
    /// The type that it holds, if any.
    pub holds: Option<String>,
    pub fields: Vec<Field>,
}

/// Every item of the files below these folders, up to their tests.
pub(crate) fn items(folders: &[&Path]) -> Vec<Item> {
    let mut found = vec![];
    for path in folders.iter().flat_map(|folder| super::files(folder, "rs")) {
        let text = plain(&std::fs::read_to_string(&path).expect("a source is text"));
        let before = text.split("#[cfg(test)]\nmod tests {").next().expect("one part");
        let lines: Vec<&str> = before.lines().collect();
        let derives = |l: &&str| l.starts_with("#[derive(") && l.contains("Deserialize");
        for at in (0..lines.len()).filter(|at| derives(&lines[*at])) {
            found.extend(item(&lines, at, &path));
        }
    }
    found
}

/// The text with the structs of `settings!` as plain ones.
fn plain(text: &str) -> String {
    let (mut out, mut inside) = (String::new(), false);
    for line in text.lines() {
        match line {
            "foveate_base::settings! {" => inside = true,
            "}" if inside => inside = false,
            _ if inside => {
                let line = line.strip_prefix("    ").unwrap_or(line);
                if line.starts_with("pub struct") {
                    out += "#[derive(Deserialize)]\n#[serde(default)]\n";
                }
                let field = line.starts_with("    pub ").then(|| line.split_once(" = ")).flatten();
                out += &field.map_or_else(|| line.to_owned(), |(field, _)| format!("{field},"));
                out.push('\n');
            }
            _ => out += &format!("{line}\n"),
        }
    }
    out
}

/// The item that a path in a source of `from` names.
pub(crate) fn resolve<'a>(items: &'a [Item], kind: &str) -> Option<&'a Item> {
    let (module, name) = kind.rsplit_once("::").unwrap_or(("", kind));
    let module = module.rsplit("::").next().expect("one part");
    let mut named = items.iter().filter(|item| item.name == name);
    let inside =
        |item: &&Item| item.file.contains(&format!("/{module}/")) || item.file.ends_with(&format!("/{module}.rs"));
    if module.is_empty() {
        let found = named.next();
        assert!(found.is_none() || named.next().is_none(), "{name} is the name of several items: write its module");
        return found;
    }
    named.find(inside)
}

fn item(lines: &[&str], derive: usize, path: &Path) -> Option<Item> {
    let mut head = derive + 1;
    let mut serde = String::new();
    while !lines[head].starts_with("pub ") {
        if lines[head].starts_with("struct ") || lines[head].starts_with("enum ") || lines[head].is_empty() {
            return None;
        }
        serde += lines[head];
        head += 1;
    }
    let mut words = lines[head].split([' ', '<', '(', ';']).skip(1);
    let (what, name) = (words.next()?, words.next()?.to_owned());
    let end = if lines[head].ends_with('{') { head + lines[head..].iter().position(|l| *l == "}")? } else { head + 1 };
    let body = &lines[head + 1..end];
    let all_default = serde.contains("default");
    let body = match what {
        "struct" => Body::Struct(fields(body, 4, all_default)),
        _ => Body::Enum(variants(body)),
    };
    let file = path.to_string_lossy().replace('\\', "/");
    Some(Item { name, file, tagged: serde.contains("tag = \"kind\""), body })
}

/// The `///` lines above line `at` and its attributes, as one paragraph.
fn docs(lines: &[&str], at: usize) -> String {
    let above = lines[..at].iter().rev().map(|l| l.trim_start());
    let mut docs: Vec<&str> = above
        .skip_while(|l| l.starts_with("#[") || l.starts_with(')') || l.ends_with(',') && !l.starts_with("///"))
        .take_while(|l| l.starts_with("///"))
        .map(|l| l.trim_start_matches('/').trim())
        .collect();
    docs.reverse();
    docs.join(" ").replace("[`", "`").replace("`]", "`").trim().to_owned()
}

/// Fields that are indented by `indent`.
fn fields(lines: &[&str], indent: usize, all_default: bool) -> Vec<Field> {
    let mut found = vec![];
    for (at, line) in lines.iter().enumerate() {
        let code = line.trim_start();
        let deeper = line.len() - code.len() != indent;
        let Some((name, kind)) = code.trim_start_matches("pub ").split_once(": ") else { continue };
        if deeper || !code.ends_with(',') || !name.chars().all(|c| c.is_alphanumeric() || c == '_') {
            continue;
        }
        let attributes: String =
            lines[..at].iter().rev().take_while(|l| l.trim_start().starts_with("#[")).copied().collect();
        if attributes.contains("serde(skip") && !attributes.contains("skip_serializing_if") {
            continue;
        }
        let kind = kind.trim_end_matches(',');
        let inner = |kind: &str, outer: &str| {
            kind.strip_prefix(outer).and_then(|k| k.strip_prefix('<')?.strip_suffix('>')).map(str::to_owned)
        };
        let option = inner(kind, "Option");
        let (optional, kind) = (option.is_some(), option.unwrap_or_else(|| kind.to_owned()));
        let kind = inner(&kind, "Box").unwrap_or(kind);
        let required = !(optional || all_default || attributes.contains("default"));
        found.push(Field { name: name.to_owned(), kind, docs: docs(lines, at), optional, required });
    }
    found
}

fn variants(lines: &[&str]) -> Vec<Variant> {
    let mut found = vec![];
    for (at, line) in lines.iter().enumerate() {
        let code = line.trim_start();
        let skipped = at > 0 && lines[at - 1].trim() == "#[serde(skip)]";
        if line.len() - code.len() != 4 || !code.starts_with(char::is_uppercase) || skipped {
            continue;
        }
        let name: String = code.chars().take_while(|c| c.is_alphanumeric()).collect();
        let rest = &code[name.len()..];
        let end = lines[at..].iter().position(|l| *l == "    },").map_or(at, |n| at + n);
        let inner = if rest.starts_with(" {") { &lines[at + 1..end] } else { &[] };
        found.push(Variant {
            name: kebab(&name),
            docs: docs(lines, at),
            holds: rest.strip_prefix('(').and_then(|r| r.strip_suffix("),")).map(str::to_owned),
            fields: fields(inner, 8, false),
        });
    }
    found
}

fn kebab(name: &str) -> String {
    let mut out = String::new();
    for (i, c) in name.chars().enumerate() {
        if c.is_uppercase() && i > 0 {
            out.push('-');
        }
        out.extend(c.to_lowercase());
    }
    out
}
