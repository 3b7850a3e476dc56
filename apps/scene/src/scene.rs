//! A scene: the text of its file, changes of its values, and the tables that result from both.

use crate::error::{Error, Result, key, meant, value};
use crate::ranks::Ranks;
use crate::setup::{self, LoweredScene, lower};
use std::fmt::Display;
use std::ops::Range;
use std::path::{Path, PathBuf};
use toml::Value;
use toml::de::{DeTable, DeValue};

/// Path and text of a scene file.
#[derive(Debug, Clone)]
pub struct Source {
    /// Path of the file; names the scene in reports.
    pub path: PathBuf,
    /// Folder to which paths in the scene are relative.
    pub folder: PathBuf,
    /// Text of the file.
    pub text: String,
}

impl Source {
    /// Creates a source from a text; `path` need not exist.
    pub fn new(path: impl Into<PathBuf>, text: impl Into<String>) -> Self {
        let path = path.into();
        Self {
            folder: path.parent().unwrap_or_else(|| Path::new(".")).to_owned(),
            path,
            text: text.into(),
        }
    }

    /// Reads a file.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn read(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        Ok(Self::new(path, setup::text(path)?))
    }

    /// Byte range of the deepest part of a key path that the text contains; `None` if it contains no part.
    pub fn span_of(&self, path: &str) -> Option<Range<usize>> {
        let root = DeTable::parse(&self.text).ok()?;
        let mut found_span = None;
        let mut parts = path
            .split('.')
            .flat_map(|p| p.split(['[', ']']))
            .filter(|p| !p.is_empty());
        let first = parts.next()?;
        let (name, mut node) = root.get_ref().get_key_value(first)?;
        found_span.replace(name.span());
        for part in parts {
            let next = match node.get_ref() {
                DeValue::Table(t) => t
                    .get_key_value(part)
                    .map(|(k, v)| (k.span().start..v.span().end, v)),
                DeValue::Array(a) => part
                    .parse()
                    .ok()
                    .and_then(|k: usize| a.get(k))
                    .map(|v| (v.span(), v)),
                _ => None,
            };
            let Some((span, value)) = next else { break };
            // The span of a table ends with its header; messages show a single line, so spans are cut at its
            // end.
            let line = self.text[span.start..]
                .find('\n')
                .map_or(self.text.len(), |n| span.start + n);
            found_span = Some(span.start..span.end.min(line).max(span.start));
            node = value;
        }
        found_span
    }
}

/// A scene as its file and its changes describe it, before anything is built.
#[derive(Debug, Clone)]
pub struct Scene {
    source: Source,
    changes: Vec<String>,
    table: toml::Table,
    spec: LoweredScene,
    ranks: Ranks,
}

impl Scene {
    /// Reads a scene file.
    ///
    /// # Errors
    /// A file that cannot be read; a text that is no scene, with its place.
    pub fn read(path: impl AsRef<Path>) -> Result<Self> {
        Self::from_source(Source::read(path)?)
    }

    /// Reads a text; paths in it are relative to the current folder.
    ///
    /// # Errors
    /// A text that is no scene, with its place.
    pub fn from_text(text: impl Into<String>) -> Result<Self> {
        Self::from_source(Source::new("scene", text))
    }

    /// Parses the text of a file.
    ///
    /// # Errors
    /// A text that is no scene, with its place.
    pub fn from_source(source: Source) -> Result<Self> {
        let syntax = |e: toml::de::Error| Error::Syntax {
            message: in_words(e.message()),
            span: e.span(),
        };
        let table: toml::Table = toml::from_str(&source.text).map_err(syntax)?;
        plausible("", &table)?;
        // Parsed from the text, not from `table`: only then do errors have a line.
        let mut spec = lower::lowered(toml::from_str(&source.text).map_err(syntax)?)?;
        setup::locate_files(&mut spec, &source.folder);
        Ok(Self {
            source,
            changes: Vec::new(),
            table,
            spec,
            ranks: Ranks::default(),
        })
    }

    /// Sets one value by its path, such as `time.end` or `support.0.model`. A text that is no TOML value is
    /// taken as a string.
    ///
    /// # Errors
    /// A path that the scene does not have, or a value that it cannot take.
    pub fn set(mut self, path: &str, value: impl Display) -> Result<Self> {
        self.change(path.trim(), value.to_string().trim())?;
        Ok(self)
    }

    /// Plans for this number of ranks: [`Scene::prepare`] then reports how each model would be distributed
    /// ([`crate::setup::Built::holdings`]).
    #[must_use]
    pub fn for_ranks(mut self, ranks: usize) -> Self {
        self.ranks = Ranks::planned(ranks);
        self
    }

    /// Ranks of the run.
    pub(crate) fn ranks(&self) -> &Ranks {
        &self.ranks
    }

    /// Applies assignments `PATH=VALUE` in their order; `PATH=` removes a key.
    ///
    /// # Errors
    /// See [`Self::set`].
    pub fn assign(mut self, assignments: &[String]) -> Result<Self> {
        for assignment in assignments {
            let (path, value) = assignment
                .split_once('=')
                .ok_or_else(|| key(assignment, "expected PATH=VALUE, such as time.end=1e-3"))?;
            self.change(path.trim(), value.trim())?;
        }
        Ok(self)
    }

    /// Checks everything that can be checked without building the scene or starting an external solver.
    /// Collective.
    ///
    /// # Errors
    /// The key, its value, the limit and the remedy.
    pub fn check_tables(&self) -> Result<()> {
        let checked = setup::check(&self.spec, self.folder()).map_err(|e| lower::written(&self.spec, e));
        self.ranks.together(checked)
    }

    /// Lists the external solvers that [`Self::prepare`] would start or wait for: model, and command or
    /// address.
    pub fn links(&self) -> Vec<(String, String)> {
        let links = self
            .spec
            .model
            .iter()
            .filter(|m| setup::kind(m.1.kind).is_remote());
        links.map(|(n, t)| (n.clone(), setup::link_of(t))).collect()
    }

    fn change(&mut self, path: &str, value: &str) -> Result<()> {
        let bad = |message: String| Error::Set {
            key: path.to_owned(),
            value: value.to_owned(),
            message,
        };
        let changed = match value {
            "" => remove(&mut self.table, path),
            value => assign(&mut self.table, path, parse_value(value)),
        };
        changed.map_err(bad)?;
        plausible("", &self.table)?;
        self.read_table(bad)?;
        self.changes.push(format!("{path}={value}"));
        Ok(())
    }

    fn read_table(&mut self, bad: impl FnOnce(String) -> Error) -> Result<()> {
        // Reads the changed scene from text again: a second way to read all tables would take a tenth of this
        // crate's code.
        let spec = toml::from_str(&self.table.to_string())
            .map_err(|e: toml::de::Error| bad(in_words(e.message())))?;
        self.spec = lower::lowered(spec)?;
        setup::locate_files(&mut self.spec, &self.source.folder);
        Ok(())
    }

    /// The tables of the scene, changes included, with the models and interfaces of its body and zones.
    pub fn spec(&self) -> &LoweredScene {
        &self.spec
    }

    /// Returns the scene, to be run by these ranks together.
    pub(crate) fn with_ranks(self, ranks: Ranks) -> Self {
        Self { ranks, ..self }
    }

    /// The scene file, without the changes.
    pub fn source(&self) -> &Source {
        &self.source
    }

    /// The changes `PATH=VALUE`, in their order.
    pub fn changes(&self) -> &[String] {
        &self.changes
    }

    /// Folder to which paths in the scene are relative.
    pub fn folder(&self) -> &Path {
        &self.source.folder
    }

    /// Files that the scene reads, as it names them: the values of all keys `file`.
    pub fn files(&self) -> Vec<PathBuf> {
        let mut out = Vec::new();
        collect_files(&Value::Table(self.table.clone()), &mut out);
        out
    }
}

fn collect_files(node: &Value, out: &mut Vec<PathBuf>) {
    match node {
        Value::Table(t) => {
            for (key, value) in t {
                match value {
                    Value::String(name) if key == "file" => out.push(PathBuf::from(name)),
                    _ => collect_files(value, out),
                }
            }
        }
        Value::Array(a) => a.iter().for_each(|v| collect_files(v, out)),
        _ => {}
    }
}

/// Refuses NaN, infinity and dates anywhere in the scene.
fn plausible(path: &str, table: &toml::Table) -> Result<()> {
    table.iter().try_for_each(|(k, v)| match path {
        "" => plausible_value(k, v),
        _ => plausible_value(&format!("{path}.{k}"), v),
    })
}

fn plausible_value(path: &str, node: &Value) -> Result<()> {
    match node {
        Value::Float(x) if !x.is_finite() => {
            let rule =
                "must be a finite number, at most 1.8e308; give one, or remove the key for its default";
            Err(value(path, x, rule))
        }
        Value::Datetime(d) => Err(value(
            path,
            d,
            "is a date; a scene knows none: give a number in SI units",
        )),
        Value::Table(t) => plausible(path, t),
        Value::Array(a) => a
            .iter()
            .enumerate()
            .try_for_each(|(k, v)| plausible_value(&format!("{path}[{k}]"), v)),
        _ => Ok(()),
    }
}

/// Replaces Rust types in a parser's message by plain words; adds a guess to unknown names.
fn in_words(message: &str) -> String {
    const WORDS: [(&str, &str); 5] = [
        ("expected f64", "expected a number, such as 1.5e-3"),
        (
            "expected usize",
            "expected a whole number from 0 on, such as 20, below 9.2e18",
        ),
        (
            "expected u64",
            "expected a whole number from 0 on, such as 20, below 9.2e18",
        ),
        ("expected a boolean", "expected true or false"),
        (
            " as i128, expected any valid TOML value",
            ": whole numbers end at 9.2e18; write it with a point or an exponent, such as 1e20",
        ),
    ];
    let words = WORDS.iter();
    let text = words.fold(message.to_owned(), |text, (rust, plain)| {
        text.replace(rust, plain)
    });
    // In "unknown field `a`, expected one of `b`, `c`", the first quoted word is the unknown one.
    let mut quoted = text.split('`').skip(1).step_by(2);
    match quoted.next() {
        Some(wrong) if text.starts_with("unknown ") => format!("{text}{}", meant(wrong, quoted)),
        _ => text,
    }
}

/// Sets one value; `Err` says what is wrong with the path.
fn assign(root: &mut toml::Table, path: &str, new: Value) -> std::result::Result<(), String> {
    let parts = parts(path)?;
    let parts: Vec<&str> = parts.iter().map(|k| k.get()).collect();
    // Keys of these tables are names: a misspelt name must not create a new model.
    if let [table @ ("model" | "interface" | "probe" | "zone"), name, ..] = parts.as_slice() {
        let known: Vec<&String> = match root.get(*table) {
            Some(Value::Table(t)) => t.keys().collect(),
            _ => Vec::new(),
        };
        if !known.iter().any(|k| k == name) {
            let known: Vec<&str> = known.into_iter().map(String::as_str).collect();
            return Err(format!(
                "the scene has no {table} '{name}'; it has: {}{}",
                known.join(", "),
                meant(name, known.iter().copied())
            ));
        }
    }
    let (last, head) = parts.split_last().ok_or("the path is empty")?;
    let mut node = root
        .entry((*head.first().unwrap_or(last)).to_owned())
        .or_insert_with(|| Value::Table(toml::Table::new()));
    if head.is_empty() {
        *node = new;
        return Ok(());
    }
    for part in &head[1..] {
        node = child(node, part)?;
    }
    *child(node, last)? = new;
    Ok(())
}

/// Removes a key and its value.
fn remove(root: &mut toml::Table, path: &str) -> std::result::Result<(), String> {
    let parts = parts(path)?;
    let (last, head) = parts.split_last().ok_or("the path is empty")?;
    let mut table = Some(root);
    let mut head = head.iter().map(|k| k.get());
    while let Some(part) = head.next() {
        table = match table.and_then(|inside| inside.get_mut(part)) {
            Some(Value::Table(t)) => Some(t),
            // The next part is the number of an entry.
            Some(Value::Array(entries)) => {
                let entry = head
                    .next()
                    .and_then(|k| entries.get_mut(k.parse::<usize>().ok()?));
                entry.and_then(Value::as_table_mut)
            }
            _ => None,
        };
    }
    let removed = table.and_then(|t| t.remove(last.get()));
    let missing = "it is not in the scene; name a key that the scene file has, or give a value";
    removed.map(|_| ()).ok_or_else(|| missing.to_owned())
}

/// Splits a path as TOML writes it (`probe."my tip".at`). `support[0]`, as messages write it, equals
/// `support.0`.
fn parts(path: &str) -> std::result::Result<Vec<toml_edit::Key>, String> {
    let dotted = if path.contains(['"', '\'']) {
        path.to_owned()
    } else {
        path.replace('[', ".").replace(']', "")
    };
    toml_edit::Key::parse(&dotted).map_err(|_| {
        "is no path; write names with dots between them, such as time.end, and quote a name that holds others than \
         a-z, A-Z, 0-9, - and _"
            .to_owned()
    })
}

fn child<'a>(node: &'a mut Value, part: &str) -> std::result::Result<&'a mut Value, String> {
    match node {
        // A missing table is created: optional tables can be set without being in the file.
        Value::Table(t) => Ok(t
            .entry(part.to_owned())
            .or_insert_with(|| Value::Table(toml::Table::new()))),
        Value::Array(a) => {
            let count = a.len();
            let index: usize = part
                .parse()
                .map_err(|_| format!("'{part}' is no index of a list of {count}; count from 0"))?;
            a.get_mut(index)
                .ok_or_else(|| format!("there is no entry {index}: the list has {count}, counted from 0"))
        }
        _ => Err(format!(
            "'{part}' is below a plain value, which has no keys; set the whole: {{ {part} = … }}"
        )),
    }
}

/// Parses a TOML value, then a number that TOML writes differently (such as an integer beyond its range);
/// returns any other text as a string.
fn parse_value(text: &str) -> Value {
    let parsed = toml::from_str::<toml::Table>(&format!("x = {text}"));
    if let Some(v) = parsed.ok().and_then(|mut t| t.remove("x")) {
        return v;
    }
    // Rust also parses words such as "inf" as numbers; in a scene they could be names.
    let number = text
        .parse()
        .ok()
        .filter(|x: &f64| x.is_finite() || text.ends_with("NaN"));
    number.map_or_else(|| Value::String(text.to_owned()), Value::Float)
}
