//! A scene: the text of its file, the changes made to it, and what both say.

use crate::error::{Error, Result, key, value};
use crate::run::Prepared;
use crate::spec::SceneSpec;
use std::fmt::Display;
use std::ops::Range;
use std::path::{Path, PathBuf};
use toml::Value;
use toml::de::{DeTable, DeValue};

/// A scene file and its text.
#[derive(Debug, Clone)]
pub struct Source {
    /// Its path, which names the scene in reports.
    pub path: PathBuf,
    /// Folder to which paths in the scene are relative.
    pub folder: PathBuf,
    /// Its text.
    pub text: String,
}

impl Source {
    /// A text that stands, or could stand, in a file.
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
        let text = std::fs::read_to_string(path).map_err(|source| Error::Read {
            path: path.to_owned(),
            source,
        })?;
        Ok(Self::new(path, text))
    }

    /// Bytes of the deepest part of a key path that the text has.
    pub fn span_of(&self, path: &str) -> Option<Range<usize>> {
        let root = DeTable::parse(&self.text).ok()?;
        let mut found = None;
        let mut parts = path
            .split('.')
            .flat_map(|p| p.split(['[', ']']))
            .filter(|p| !p.is_empty());
        let first = parts.next()?;
        let (name, mut at) = root.get_ref().get_key_value(first)?;
        found.replace(name.span());
        for part in parts {
            let next = match at.get_ref() {
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
            // The table of a header ends where the header does; a span never runs over several lines.
            let line = self.text[span.start..]
                .find('\n')
                .map_or(self.text.len(), |n| span.start + n);
            found = Some(span.start..span.end.min(line).max(span.start));
            at = value;
        }
        found
    }
}

/// A scene as its file and the changes made to it say; nothing of it is built yet.
#[derive(Debug, Clone)]
pub struct Scene {
    source: Source,
    changes: Vec<String>,
    table: toml::Table,
    spec: SceneSpec,
}

impl Scene {
    /// Reads a scene file.
    ///
    /// # Errors
    /// A file that cannot be read; a text that is no scene, with its place.
    pub fn read(path: impl AsRef<Path>) -> Result<Self> {
        Self::of(Source::read(path)?)
    }

    /// Reads a text; paths in it are relative to the current folder.
    ///
    /// # Errors
    /// A text that is no scene, with its place.
    pub fn from_text(text: impl Into<String>) -> Result<Self> {
        Self::of(Source::new("scene", text))
    }

    /// Understands the text of a file.
    ///
    /// # Errors
    /// A text that is no scene, with its place.
    pub fn of(source: Source) -> Result<Self> {
        let syntax = |e: toml::de::Error| Error::Syntax {
            message: e.message().to_owned(),
            span: e.span(),
        };
        let table: toml::Table = toml::from_str(&source.text).map_err(syntax)?;
        // From the text, as only then errors know their line.
        let spec = toml::from_str(&source.text).map_err(syntax)?;
        let out = Self {
            source,
            changes: Vec::new(),
            table,
            spec,
        };
        out.finite()
    }

    /// Sets one value by its path, such as `time.end` or `support.0.model`; a text is a TOML value, or else itself.
    ///
    /// # Errors
    /// A path that the scene does not have, a value that it cannot take.
    pub fn set(self, path: &str, value: impl Display) -> Result<Self> {
        self.assign(&[format!("{path}={value}")])
    }

    /// Applies assignments `PATH=VALUE` in their order.
    ///
    /// # Errors
    /// As those of [`Self::set`].
    pub fn assign(mut self, assignments: &[String]) -> Result<Self> {
        for assignment in assignments {
            let bad = |message: String| Error::Set {
                assignment: assignment.clone(),
                message,
            };
            assign(&mut self.table, assignment).map_err(bad)?;
            // From its text again: a second way to read all tables would take a tenth of this crate's code.
            self.spec = toml::from_str(&self.table.to_string())
                .map_err(|e: toml::de::Error| bad(e.message().to_owned()))?;
            self.changes.push(assignment.clone());
        }
        self.finite()
    }

    /// What the scene says, changes included.
    pub fn spec(&self) -> &SceneSpec {
        &self.spec
    }

    /// The same scene with other words in place of its own.
    pub(crate) fn with_spec(&self, spec: SceneSpec) -> Self {
        Self { spec, ..self.clone() }
    }

    /// Its text without the changes.
    pub fn source(&self) -> &Source {
        &self.source
    }

    /// The changes made to it, in their order.
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

    /// Meshes, packs and couples everything the scene asks for.
    ///
    /// # Errors
    /// What is wrong with the scene: the key, its value, the limit and a way out.
    pub fn prepare(&self) -> Result<Prepared> {
        Prepared::new(self)
    }

    fn finite(self) -> Result<Self> {
        finite("", &Value::Table(self.table.clone()))?;
        Ok(self)
    }
}

fn collect_files(at: &Value, out: &mut Vec<PathBuf>) {
    match at {
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

/// Refuses NaN and infinity anywhere in the scene.
fn finite(path: &str, at: &Value) -> Result<()> {
    let join = |k: &str| {
        if path.is_empty() {
            k.to_owned()
        } else {
            format!("{path}.{k}")
        }
    };
    match at {
        Value::Float(x) if !x.is_finite() => Err(value(path, x, "must be a finite number")),
        Value::Table(t) => t.iter().try_for_each(|(k, v)| finite(&join(k), v)),
        Value::Array(a) => a
            .iter()
            .enumerate()
            .try_for_each(|(k, v)| finite(&format!("{path}[{k}]"), v)),
        Value::Datetime(d) => Err(key(path, format!("{d} is a date; a scene knows none"))),
        _ => Ok(()),
    }
}

/// Sets one value; `Err` says what is wrong with the path.
fn assign(root: &mut toml::Table, assignment: &str) -> std::result::Result<(), String> {
    let (path, text) = assignment
        .split_once('=')
        .ok_or("expected PATH=VALUE, such as time.end=1e-3")?;
    let parts: Vec<&str> = path.trim().split('.').collect();
    let new = parse_value(text.trim());
    // Tables whose keys are names: a misspelt name must not make a new model.
    if let [table @ ("model" | "interface" | "probe"), name, ..] = parts.as_slice() {
        let known: Vec<&String> = match root.get(*table) {
            Some(Value::Table(t)) => t.keys().collect(),
            _ => Vec::new(),
        };
        if !known.iter().any(|k| k == name) {
            let known: Vec<&str> = known.into_iter().map(String::as_str).collect();
            return Err(format!(
                "the scene has no {table} '{name}'; it has: {}",
                known.join(", ")
            ));
        }
    }
    let (last, head) = parts.split_last().ok_or("the path is empty")?;
    let mut at = root
        .entry((*head.first().unwrap_or(last)).to_owned())
        .or_insert_with(|| Value::Table(toml::Table::new()));
    if head.is_empty() {
        *at = new;
        return Ok(());
    }
    for part in &head[1..] {
        at = child(at, part)?;
    }
    *child(at, last)? = new;
    Ok(())
}

fn child<'a>(at: &'a mut Value, part: &str) -> std::result::Result<&'a mut Value, String> {
    match at {
        Value::Table(t) => Ok(t
            .entry(part.to_owned())
            .or_insert_with(|| Value::Table(toml::Table::new()))),
        Value::Array(a) => {
            let count = a.len();
            let index: usize = part
                .parse()
                .map_err(|_| format!("'{part}' is no index of a list of {count}"))?;
            a.get_mut(index)
                .ok_or_else(|| format!("there is no entry {index}: the list has {count}"))
        }
        _ => Err(format!("'{part}' is below a plain value, which has no keys")),
    }
}

/// A TOML value, or else the text itself.
fn parse_value(text: &str) -> Value {
    let parsed = toml::from_str::<toml::Table>(&format!("x = {text}"));
    match parsed.ok().and_then(|mut t| t.remove("x")) {
        Some(v) => v,
        None => Value::String(text.to_owned()),
    }
}
