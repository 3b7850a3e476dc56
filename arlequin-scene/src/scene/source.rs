//! The text of a scene: reading, `--set`, and where in the text a key stands.

use super::Scene;
use crate::error::{Error, Result, key, value};
use serde::Deserialize;
use std::ops::Range;
use std::path::{Path, PathBuf};
use toml::Value;
use toml::de::{DeTable, DeValue};

/// A scene file and its text.
#[derive(Debug, Clone)]
pub struct Source {
    /// As given on the command line.
    pub path: PathBuf,
    /// Folder to which its paths are relative, if not that of the file.
    pub base: Option<PathBuf>,
    /// Its text.
    pub text: String,
}

impl Source {
    /// Reads the text.
    pub fn read(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).map_err(|source| Error::Read {
            path: path.to_owned(),
            source,
        })?;
        Ok(Self {
            path: path.to_owned(),
            base: None,
            text,
        })
    }

    /// The scene with assignments `path=value` applied in order.
    pub fn scene(&self, assignments: &[String]) -> Result<Scene> {
        self.read_with(assignments).map(|(scene, _)| scene)
    }

    /// Files that the scene reads, as it names them: the values of all keys `file`.
    pub fn files(&self, assignments: &[String]) -> Result<Vec<PathBuf>> {
        let (_, table) = self.read_with(assignments)?;
        let mut out = Vec::new();
        collect_files(&Value::Table(table), &mut out);
        Ok(out)
    }

    fn read_with(&self, assignments: &[String]) -> Result<(Scene, toml::Table)> {
        let syntax = |e: toml::de::Error| Error::Syntax {
            message: e.message().to_owned(),
            span: e.span(),
        };
        let mut table: toml::Table = toml::from_str(&self.text).map_err(syntax)?;
        // From the text first, as only then errors know their line.
        let mut scene: Scene = toml::from_str(&self.text).map_err(syntax)?;
        for assignment in assignments {
            let bad = |message: String| Error::Set {
                assignment: assignment.clone(),
                message,
            };
            assign(&mut table, assignment).map_err(bad)?;
            scene = Scene::deserialize(table.clone()).map_err(|e| bad(e.message().to_owned()))?;
        }
        finite("", &Value::Table(table.clone()))?;
        Ok((scene, table))
    }

    /// Folder of the file, to which paths in the scene are relative.
    pub fn folder(&self) -> &Path {
        let beside = || self.path.parent().unwrap_or_else(|| Path::new("."));
        self.base.as_deref().unwrap_or_else(beside)
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
