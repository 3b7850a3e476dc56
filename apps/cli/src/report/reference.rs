//! Writes the reference of scenes in Markdown from their JSON Schema: one row per key, with unit, meaning
//! and default.

use serde_json::{Map, Value};
use std::collections::BTreeMap;
use std::fmt::Write as _;

type Object = Map<String, Value>;

const HEAD: &str = "# Every key of a scene\n\nWritten from the types that read scenes, by `arlequin schema --reference`. All numbers are SI. \
                    A key without a default that is not needed is left out; tables of choices take exactly one of their keys.\n";

/// State of the page being written.
struct Writer<'a> {
    definitions: &'a Object,
    /// Number of references to each definition. Definitions with several references get their own section.
    uses: BTreeMap<&'a str, usize>,
    /// Definitions whose section is still to be written, in the order of their first reference.
    pending: Vec<&'a str>,
    out: String,
}

/// Returns the reference of a schema: a section per key at the top level, and one per table that several
/// keys share.
pub(crate) fn markdown(schema: &Value) -> String {
    let none = Object::new();
    let definitions = schema["definitions"].as_object().unwrap_or(&none);
    let mut uses = BTreeMap::new();
    count(schema, &mut uses);
    let mut w = Writer {
        definitions,
        uses,
        pending: Vec::new(),
        out: HEAD.to_owned(),
    };
    w.top(schema);
    // Writing a section may add further ones.
    let mut k = 0;
    while let Some(name) = w.pending.get(k).copied() {
        w.shared(name);
        k += 1;
    }
    w.out
}

/// Counts the references to every definition.
fn count<'a>(node: &'a Value, uses: &mut BTreeMap<&'a str, usize>) {
    match node {
        Value::Object(o) => {
            if let Some(name) = referred(o) {
                *uses.entry(name).or_default() += 1;
            }
            o.values().for_each(|v| count(v, uses));
        }
        Value::Array(a) => a.iter().for_each(|v| count(v, uses)),
        _ => {}
    }
}

/// Returns the definition that a schema refers to.
fn referred(schema: &Object) -> Option<&str> {
    schema.get("$ref")?.as_str()?.rsplit('/').next()
}

fn text<'a>(schema: &'a Object, key: &str) -> &'a str {
    schema.get(key).and_then(Value::as_str).unwrap_or_default()
}

fn objects<'a>(schema: &'a Object, key: &str) -> impl Iterator<Item = &'a Object> {
    let list = schema.get(key).and_then(Value::as_array);
    list.into_iter().flatten().filter_map(Value::as_object)
}

impl<'a> Writer<'a> {
    /// Returns the schema behind a reference, and the name of its definition.
    fn resolve(&self, schema: &'a Object) -> (&'a Object, Option<&'a str>) {
        // A reference with a description is wrapped in `allOf`.
        let inner = objects(schema, "allOf").next().unwrap_or(schema);
        let definition = referred(inner).and_then(|n| Some((self.definitions.get_key_value(n)?, n)));
        match definition {
            Some(((name, Value::Object(o)), _)) => (o, Some(name)),
            _ => (inner, None),
        }
    }

    fn top(&mut self, schema: &'a Value) {
        let Some(root) = schema.as_object() else { return };
        self.head("Top level", text(root, "description"));
        let mut sections = Vec::new();
        for (key, schema, needed) in properties(root) {
            let (inner, many) = match (schema.get("additionalProperties"), schema.get("items")) {
                (Some(Value::Object(o)), _) => (o, "named"),
                (_, Some(Value::Object(o))) => (o, "list"),
                _ => (schema, ""),
            };
            let (table, _) = self.resolve(inner);
            let shown = match many {
                "named" => format!("[{key}.NAME]"),
                "list" if is_table(table) => format!("[[{key}]]"),
                _ if is_table(table) => format!("[{key}]"),
                _ => key.clone(),
            };
            self.row(&shown, schema, Some(needed));
            if is_table(table) {
                sections.push((shown, schema, table));
            }
        }
        for (shown, schema, table) in sections {
            self.head(&format!("`{shown}`"), text(schema, "description"));
            self.rows("", table);
        }
    }

    /// Writes the section of a table that several keys share.
    fn shared(&mut self, name: &'a str) {
        let Some(Value::Object(schema)) = self.definitions.get(name) else {
            return;
        };
        self.head(&words(name), text(schema, "description"));
        self.rows("", schema);
    }

    fn head(&mut self, title: &str, description: &str) {
        let _ = write!(self.out, "\n## {title}\n\n");
        if !description.is_empty() {
            let _ = write!(self.out, "{}\n\n", sentence(description).0);
        }
        self.out += "| key | unit | meaning | default |\n|---|---|---|---|\n";
    }

    /// Writes the rows of all keys of a table, or of its choices.
    fn rows(&mut self, prefix: &str, table: &'a Object) {
        for (key, schema, needed) in properties(table) {
            self.key(&join(prefix, key), schema, needed);
        }
        for choice in objects(table, "oneOf").chain(objects(table, "anyOf")) {
            let (inner, named) = self.resolve(choice);
            if named.is_some() {
                self.rows(prefix, inner);
            } else if text(choice, "type") == "string" && !prefix.is_empty() {
                // The row of the key lists these words.
            } else if text(choice, "type") == "string" {
                let name = choice
                    .get("const")
                    .and_then(Value::as_str)
                    .map(|c| format!("\"{c}\""));
                self.row(name.as_deref().unwrap_or("a text"), choice, None);
            }
            for (key, schema, _) in properties(choice) {
                let row = if schema.contains_key("description") {
                    schema
                } else {
                    choice
                };
                let name = join(prefix, key);
                self.row(&name, row, None);
                let (inner, shared) = self.resolve(schema);
                match shared {
                    Some(other) if self.is_shared(other) => self.later(other),
                    _ => self.rows(&name, inner),
                }
            }
        }
    }

    /// Writes the row of a key and the rows below it.
    fn key(&mut self, name: &str, schema: &'a Object, needed: bool) {
        self.row(name, schema, Some(needed));
        let items = schema.get("items").and_then(Value::as_object);
        let (inner, definition) = self.resolve(items.unwrap_or(schema));
        match definition {
            Some(other) if self.is_shared(other) && is_table(inner) => self.later(other),
            _ if is_table(inner) => self.rows(name, inner),
            _ => {}
        }
    }

    fn is_shared(&self, name: &str) -> bool {
        self.uses.get(name).is_some_and(|n| *n > 1)
    }

    /// Remembers that a shared table needs a section.
    fn later(&mut self, name: &'a str) {
        if !self.pending.contains(&name) {
            self.pending.push(name);
        }
    }

    /// Writes the row of a key. `needed` is `None` for one of several choices.
    fn row(&mut self, name: &str, schema: &'a Object, needed: Option<bool>) {
        let (meaning, said) = sentence(text(schema, "description"));
        let (meaning, unit) = without_unit(&meaning);
        let items = schema.get("items").and_then(Value::as_object);
        let (inner, definition) = self.resolve(items.unwrap_or(schema));
        let mut cell = meaning;
        if let Some(d) = definition.filter(|d| self.is_shared(d) && is_table(inner)) {
            let _ = write!(
                cell,
                " See [{}](#{}).",
                words(d),
                words(d).to_lowercase().replace(' ', "-")
            );
        }
        let choices = choices(inner);
        if !choices.is_empty() && !is_named_in(&cell, inner) {
            let _ = write!(cell, " {choices}");
        }
        let default = schema.get("default").map(plain).unwrap_or_default();
        let default = match (said, needed) {
            (Some(words), _) => words,
            (None, None) => String::new(),
            (None, Some(true)) => "needed".into(),
            (None, Some(false)) if !default.is_empty() => format!("`{default}`"),
            // The rows of the table's keys show their defaults.
            (None, Some(false)) if is_table(inner) => String::new(),
            (None, Some(false)) => "none".into(),
        };
        let bar = |t: &str| t.replace('|', "\\|");
        let _ = writeln!(
            self.out,
            "| `{name}` | {} | {} | {} |",
            bar(&unit),
            bar(cell.trim()),
            bar(&default)
        );
    }
}

/// Returns the keys of a table with their schemas, and whether each is needed. Keys keep the order of
/// declaration if the schema keeps it.
fn properties(table: &Object) -> impl Iterator<Item = (&String, &Object, bool)> {
    let needed = |key: &String| {
        let list = table.get("required").and_then(Value::as_array);
        list.is_some_and(|l| l.iter().any(|r| r.as_str() == Some(key)))
    };
    let entries = table.get("properties").and_then(Value::as_object);
    let entries = entries.into_iter().flatten();
    entries.filter_map(move |(k, v)| Some((k, v.as_object()?, needed(k))))
}

/// Returns whether a schema has keys, directly or in one of its choices.
fn is_table(schema: &Object) -> bool {
    schema.contains_key("properties")
        || objects(schema, "oneOf")
            .chain(objects(schema, "anyOf"))
            .any(|c| ["properties", "$ref", "allOf"].iter().any(|k| c.contains_key(*k)))
}

/// Returns the words that a key may take, with the meaning of each.
fn choices(schema: &Object) -> String {
    let plain = schema.get("enum").and_then(Value::as_array);
    let plain = plain.into_iter().flatten().filter_map(Value::as_str);
    let mut entries: Vec<String> = plain.map(|w| format!("`\"{w}\"`")).collect();
    for c in objects(schema, "oneOf").filter(|_| !is_table(schema)) {
        let names = c.get("enum").and_then(Value::as_array).into_iter().flatten();
        let names = names.chain(c.get("const")).filter_map(Value::as_str);
        let (meaning, _) = sentence(text(c, "description"));
        let meaning = begun_small(meaning.trim_end_matches('.'));
        entries.extend(names.map(|w| match meaning.as_str() {
            "" => format!("`\"{w}\"`"),
            m => format!("`\"{w}\"`: {m}"),
        }));
    }
    match entries.is_empty() {
        true => String::new(),
        false => entries.join("; ") + ".",
    }
}

/// Returns whether the meaning of a key already names all of its words.
fn is_named_in(meaning: &str, schema: &Object) -> bool {
    let plain = schema.get("enum").and_then(Value::as_array);
    let mut plain = plain.into_iter().flatten().filter_map(Value::as_str).peekable();
    plain.peek().is_some() && plain.all(|w| meaning.contains(&format!("`{w}`")))
}

/// Splits a description into its meaning on one line and its text after `Default:`.
fn sentence(description: &str) -> (String, Option<String>) {
    let line = description.split_whitespace().collect::<Vec<_>>().join(" ");
    match line.split_once(" Default: ") {
        Some((meaning, default)) => {
            let default = default.strip_suffix('.').unwrap_or(default);
            (meaning.to_owned(), Some(default.to_owned()))
        }
        None => (line, None),
    }
}

/// Splits the first unit in brackets from a meaning.
fn without_unit(meaning: &str) -> (String, String) {
    let inside = |t: &str| t.len() < 14 && !t.contains([',', '`', '"', '.']);
    let split = meaning.find(" [").and_then(|from| {
        let end = from + meaning[from..].find(']')?;
        let unit = &meaning[from + 2..end];
        // A bracket before `(` is a Markdown link.
        let is_unit = inside(unit) && !meaning[end + 1..].starts_with('(');
        is_unit.then(|| {
            (
                format!("{}{}", &meaning[..from], &meaning[end + 1..]),
                unit.to_owned(),
            )
        })
    });
    split.unwrap_or_else(|| (meaning.to_owned(), String::new()))
}

/// Returns a text with its first letter in lower case, unless it begins with a name or a formula.
fn begun_small(text: &str) -> String {
    let mut letters = text.chars();
    match (letters.next(), letters.as_str()) {
        (Some(first), rest) if rest.starts_with(|c: char| c.is_lowercase() || c == ' ') => {
            first.to_lowercase().chain(rest.chars()).collect()
        }
        _ => text.to_owned(),
    }
}

/// Converts `MediatorTable` to `Mediator table`.
fn words(name: &str) -> String {
    let mut out = String::new();
    for (k, c) in name.chars().enumerate() {
        if k > 0 && c.is_uppercase() {
            out.push(' ');
            out.extend(c.to_lowercase());
        } else {
            out.push(c);
        }
    }
    out
}

fn join(prefix: &str, key: &str) -> String {
    if prefix.is_empty() {
        key.to_owned()
    } else {
        format!("{prefix}.{key}")
    }
}

/// Returns a default as TOML; empty for tables and empty lists.
fn plain(value: &Value) -> String {
    match value {
        Value::Object(_) | Value::Null => String::new(),
        Value::Array(a) if a.is_empty() => String::new(),
        other => other.to_string(),
    }
}
