//! Functions of time, from expressions and from tables in files; functions of the place.

use super::files;
use crate::error::{Error, Result, key, value};
use crate::setup::LoweredScene;
use crate::spec::TimeShape;
use arlequin::core::Formula;
use arlequin::core::nalgebra::Point3;
use std::path::Path;

/// Deepest nesting of an expression; bounds the recursion of the parser.
const DEEP: usize = 100;

/// A node of the syntax tree of an expression.
enum Node {
    Number(f64),
    /// A variable, by its number among the names of the expression.
    Variable(usize),
    One(fn(f64) -> f64, Box<Self>),
    Two(fn(f64, f64) -> f64, Box<[Self; 2]>),
}

impl Node {
    fn value(&self, variables: &[f64]) -> f64 {
        let value = |node: &Self| node.value(variables);
        match self {
            Self::Number(x) => *x,
            Self::Variable(k) => variables[*k],
            Self::One(f, x) => f(value(x)),
            Self::Two(f, x) => f(value(&x[0]), value(&x[1])),
        }
    }

    fn two(f: fn(f64, f64) -> f64, a: Self, b: Self) -> Self {
        Self::Two(f, Box::new([a, b]))
    }
}

/// Name and body of a function of one argument.
type One = (&'static str, fn(f64) -> f64);
/// Name and body of a function of two arguments.
type Two = (&'static str, fn(f64, f64) -> f64);

/// Functions of one argument.
const ONE: [One; 18] = [
    ("sin", f64::sin),
    ("cos", f64::cos),
    ("tan", f64::tan),
    ("asin", f64::asin),
    ("acos", f64::acos),
    ("atan", f64::atan),
    ("sinh", f64::sinh),
    ("cosh", f64::cosh),
    ("tanh", f64::tanh),
    ("exp", f64::exp),
    ("ln", f64::ln),
    ("log10", f64::log10),
    ("sqrt", f64::sqrt),
    ("abs", f64::abs),
    ("floor", f64::floor),
    ("ceil", f64::ceil),
    ("round", f64::round),
    ("step", |x| f64::from(u8::from(x >= 0.0))),
];

/// Functions of two arguments.
const TWO: [Two; 3] = [
    ("min", |a, b| number(a, b, a.min(b))),
    ("max", |a, b| number(a, b, a.max(b))),
    ("atan2", f64::atan2),
];

/// Returns `value`, or NaN if an argument is NaN: `f64::min` and `f64::max` would ignore it.
fn number(a: f64, b: f64, value: f64) -> f64 {
    if a.is_nan() || b.is_nan() { f64::NAN } else { value }
}

/// Names of the variables of an expression, and their meaning for messages.
struct Variables {
    names: &'static [&'static str],
    meaning: &'static str,
}

const TIME: Variables = Variables {
    names: &["t"],
    meaning: "t, the time in s",
};
const PLACE: Variables = Variables {
    names: &["x", "y", "z"],
    meaning: "x, y and z, the place in m",
};
const PLACE_AND_TIME: Variables = Variables {
    names: &["x", "y", "z", "t"],
    meaning: "x, y and z, the place in m, and t, the time in s",
};

/// Parser of expressions in mathematical notation: `-t^2` is `-(t^2)`, `2^3^2` is `2^(3^2)`.
struct Parser<'a> {
    variables: &'a Variables,
    remainder: &'a str,
    depth: usize,
}

impl Parser<'_> {
    /// Skips spaces and consumes the character `character` if it comes next; returns whether it did.
    fn sign(&mut self, character: char) -> bool {
        self.remainder = self.remainder.trim_start();
        let Some(remainder) = self.remainder.strip_prefix(character) else {
            return false;
        };
        self.remainder = remainder;
        true
    }

    /// Consumes and returns the longest prefix whose characters all satisfy `fits(byte index, character)`.
    fn take(&mut self, fits: impl Fn(usize, char) -> bool) -> String {
        let end = self.remainder.char_indices().find(|(k, c)| !fits(*k, *c));
        let (word, remainder) = self.remainder.split_at(end.map_or(self.remainder.len(), |e| e.0));
        self.remainder = remainder;
        word.to_owned()
    }

    fn sum(&mut self) -> Result<Node, String> {
        // Brackets nest by recursion: without a limit a long line could overflow the stack.
        self.depth += 1;
        if self.depth > DEEP {
            return Err(format!("is nested more than {DEEP} deep"));
        }
        let mut out = self.product()?;
        loop {
            if self.sign('+') {
                out = Node::two(|a, b| a + b, out, self.product()?);
            } else if self.sign('-') {
                out = Node::two(|a, b| a - b, out, self.product()?);
            } else {
                self.depth -= 1;
                return Ok(out);
            }
        }
    }

    fn product(&mut self) -> Result<Node, String> {
        let mut out = self.signed()?;
        loop {
            if self.sign('*') {
                out = Node::two(|a, b| a * b, out, self.signed()?);
            } else if self.sign('/') {
                out = Node::two(|a, b| a / b, out, self.signed()?);
            } else {
                return Ok(out);
            }
        }
    }

    fn signed(&mut self) -> Result<Node, String> {
        let mut negative = false;
        loop {
            if self.sign('-') {
                // Signs before a factor cancel in pairs: `--t` is `t`.
                negative = !negative;
            } else if !self.sign('+') {
                break;
            }
        }
        let base = self.atom()?;
        let value = if self.sign('^') {
            self.depth += 1;
            if self.depth > DEEP {
                return Err(format!("is nested more than {DEEP} deep"));
            }
            // The power may have a sign and a power of its own: `2^-t`, `2^3^2`.
            let power = self.signed()?;
            self.depth -= 1;
            Node::two(f64::powf, base, power)
        } else {
            base
        };
        // The sign applies after the power: `-t^2` is `-(t^2)`.
        Ok(if negative {
            Node::One(|x| -x, Box::new(value))
        } else {
            value
        })
    }

    fn atom(&mut self) -> Result<Node, String> {
        if self.sign('(') {
            let inner = self.sum()?;
            return self.close(inner);
        }
        let names = self.variables.names.join(", ");
        match self.remainder.chars().next() {
            Some(c) if c.is_ascii_digit() || c == '.' => self.number(),
            Some(c) if c.is_ascii_alphabetic() => self.word(),
            Some(c) => Err(format!(
                "has '{c}' where a number, {names}, a function or a bracket should be"
            )),
            None => Err(format!(
                "ends where a number, {names}, a function or a bracket should be"
            )),
        }
    }

    fn number(&mut self) -> Result<Node, String> {
        let text = self.remainder.as_bytes();
        let exponent = |k: usize| k > 0 && matches!(text[k - 1], b'e' | b'E');
        // A sign belongs to the number only behind its exponent letter; elsewhere it is an operator.
        let digits = self.take(|k, c| {
            c.is_ascii_digit() || c == '.' || matches!(c, 'e' | 'E') || ("+-".contains(c) && exponent(k))
        });
        digits
            .parse()
            .map(Node::Number)
            .map_err(|_| format!("has '{digits}', which is no number"))
    }

    fn word(&mut self) -> Result<Node, String> {
        let name = self.take(|_, c| c.is_ascii_alphanumeric() || c == '_');
        let meaning = self.variables.meaning;
        let unknown_name = |list: &str| format!("knows no '{name}'; it knows {meaning}, pi, {list}");
        if !self.sign('(') {
            let variable = self.variables.names.iter().position(|n| *n == name);
            return match (variable, name.as_str()) {
                (Some(k), _) => Ok(Node::Variable(k)),
                (None, "pi" | "PI") => Ok(Node::Number(std::f64::consts::PI)),
                _ => Err(unknown_name("numbers and functions with brackets behind them")),
            };
        }
        let first = self.sum()?;
        if let Some((_, f)) = ONE.iter().find(|f| f.0 == name) {
            return self.close(Node::One(*f, Box::new(first)));
        }
        let Some((_, f)) = TWO.iter().find(|f| f.0 == name) else {
            let names = ONE.iter().map(|f| f.0).chain(TWO.iter().map(|f| f.0));
            return Err(unknown_name(&names.collect::<Vec<_>>().join(", ")));
        };
        if !self.sign(',') {
            return Err(format!(
                "gives {name} one argument; it takes two, with a comma between them"
            ));
        }
        let second = self.sum()?;
        self.close(Node::two(*f, first, second))
    }

    fn close(&mut self, inner: Node) -> Result<Node, String> {
        if self.sign(')') {
            return Ok(inner);
        }
        match self.remainder.chars().next() {
            None => Err("lacks a closing bracket".to_owned()),
            Some(c) => Err(format!("has '{c}' where a bracket should close")),
        }
    }
}

/// Returns the syntax tree of the expression at key `path`.
fn node(path: &str, text: &str, variables: &Variables) -> Result<Node> {
    let mut parser = Parser {
        variables,
        remainder: text,
        depth: 0,
    };
    let read = parser
        .sum()
        .and_then(|node| match parser.remainder.trim_start().chars().next() {
            None => Ok(node),
            Some(c) => Err(format!("has '{c}' where it should go on with + - * / ^ or end")),
        });
    read.map_err(|rule| value(path, format_args!("\"{text}\""), &rule))
}

/// Returns the function of time `t` \[s\] that an expression describes.
pub(super) fn formula(path: &str, text: &str) -> Result<Formula> {
    let node = node(&format!("{path}.expression"), text, &TIME)?;
    Ok(Formula::new(text, move |t| node.value(&[t])))
}

/// Returns the function of the place \[m\] that the expression at key `path` describes.
pub(super) fn profile(path: &str, text: &str) -> Result<impl Fn(&Point3<f64>) -> f64 + use<>> {
    let node = node(path, text, &PLACE)?;
    Ok(move |x: &Point3<f64>| node.value(&[x.x, x.y, x.z]))
}

/// Refuses what is no expression of the place \[m\] and of time \[s\].
pub(super) fn check_profile(path: &str, text: &str) -> Result<()> {
    node(path, text, &PLACE_AND_TIME).map(|_| ())
}

/// Returns the expression with its variable `t` replaced by the time \[s\].
pub(super) fn with_time(text: &str, time: f64) -> String {
    let in_word = |c: Option<char>| c.is_some_and(|c| c.is_alphanumeric() || c == '_' || c == '.');
    let mut out = String::new();
    for (k, c) in text.char_indices() {
        match c {
            't' if !in_word(text[..k].chars().next_back()) && !in_word(text[k + 1..].chars().next()) => {
                out += &format!("({time:?})");
            }
            _ => out.push(c),
        }
    }
    out
}

/// Numbers of a file with comma-separated values, row by row, each with its line number; a first row of words
/// is a header.
fn numbers(path: &str, folder: &Path, name: &str) -> Result<Vec<(usize, Vec<f64>)>> {
    let text = files::text(&folder.join(name))?;
    let mut out = Vec::new();
    // Spreadsheets write a byte order mark before the first row.
    let text = text.strip_prefix('\u{feff}').unwrap_or(&text);
    // A row that starts with a digit, or has a number in any cell, is data: a misprint in it must not turn it
    // into a header.
    let words = |line: &str| {
        let mut cells = line.split([',', ';']);
        !line.starts_with(|c: char| c.is_ascii_digit() || "+-.".contains(c))
            && !cells.any(|c| c.trim().parse::<f64>().is_ok())
    };
    for (k, line) in text.lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let row: Option<Vec<f64>> = line.split([',', ';']).map(|c| c.trim().parse().ok()).collect();
        match row {
            Some(row) if row.iter().all(|x| x.is_finite()) => out.push((k + 1, row)),
            None if out.is_empty() && words(line) => {}
            _ => {
                let rule = format!(
                    "'{name}' line {}: is no row of finite numbers with commas between them",
                    k + 1
                );
                return Err(key(format!("{path}.file"), rule));
            }
        }
    }
    if out.is_empty() {
        let rule = format!("'{name}' has no row of numbers, such as 0.0,1.5");
        return Err(key(format!("{path}.file"), rule));
    }
    Ok(out)
}

/// Ascending times \[s\] in the first column of a file.
pub(super) fn times(path: &str, folder: &Path, name: &str) -> Result<Vec<f64>> {
    let rows = numbers(path, folder, name)?;
    let times: Vec<f64> = rows.iter().map(|(_, row)| row[0]).collect();
    match times.windows(2).position(|w| w[0] >= w[1]) {
        None => Ok(times),
        Some(k) => Err(falling(path, name, rows[k + 1].0)),
    }
}

fn falling(path: &str, name: &str, line: usize) -> Error {
    key(
        format!("{path}.file"),
        format!("'{name}' line {line}: times must rise from row to row"),
    )
}

/// Rows of ascending time \[s\] and value in a file.
fn rows(path: &str, folder: &Path, name: &str) -> Result<Vec<(f64, f64)>> {
    let mut out: Vec<(f64, f64)> = Vec::new();
    for (line, row) in numbers(path, folder, name)? {
        let &[t, v] = row.as_slice() else {
            let rule = format!("'{name}' line {line}: needs two numbers, time [s] and value");
            return Err(key(format!("{path}.file"), rule));
        };
        // Interpolation divides by the difference of two times.
        if out.last().is_some_and(|l| l.0 >= t) {
            return Err(falling(path, name, line));
        }
        out.push((t, v));
    }
    Ok(out)
}

/// Refuses an expression that is not finite at one of 1001 times of the run, or at a load step: otherwise the
/// run would fail later without naming the expression.
fn finite(path: &str, text: &str, scene: &LoweredScene) -> Result<()> {
    let f = formula(path, text)?;
    let listed = scene.statics.as_ref().and_then(|s| s.times.clone());
    let end = scene.statics.as_ref().map(|s| s.end).or(scene.time.end);
    let even = || {
        (0..=1000)
            .map(|k| end.unwrap_or(0.0) * f64::from(k) / 1000.0)
            .collect()
    };
    let times: Vec<f64> = listed.unwrap_or_else(even);
    match times.into_iter().find(|t| !f.value(*t).is_finite()) {
        None => Ok(()),
        Some(t) => {
            let rule = format!(
                "is {} at t = {t:e} s; give one that is finite at all times of the run",
                f.value(t)
            );
            Err(value(
                format!("{path}.expression"),
                format_args!("\"{text}\""),
                &rule,
            ))
        }
    }
}

/// Returns the scene with the tables of files in place of their names; checks all expressions.
pub(super) fn with_tables(scene: &LoweredScene, folder: &Path) -> Result<LoweredScene> {
    let mut out = scene.clone();
    let read = |path: String, shape: &mut TimeShape| {
        match shape {
            TimeShape::File(name) => *shape = TimeShape::Table(rows(&path, folder, name)?),
            TimeShape::Expression(text) => finite(&path, text, scene)?,
            _ => {}
        }
        Ok(())
    };
    for (k, s) in out.support.iter_mut().enumerate() {
        if let Some(m) = &mut s.motion {
            read(format!("support[{k}].motion.time"), &mut m.time)?;
        }
    }
    for (k, l) in out.load.iter_mut().enumerate() {
        read(format!("load[{k}].time"), &mut l.time)?;
    }
    for (k, e) in out.effect.iter_mut().enumerate() {
        let path = format!("effect[{k}].{}", e.kind.key());
        if let Some((name, time)) = e.kind.time_mut() {
            read(format!("{path}.{name}"), time)?;
        }
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(text: &str, t: f64) -> f64 {
        formula("load[0].time", text).expect("an expression").value(t)
    }

    #[test]
    fn expressions_have_the_values_of_mathematics() {
        for (text, t, wanted) in [
            ("1.5e-3 * sin(2*pi*50*t)", 1.0 / 600.0, 1.5e-3 * 0.5),
            ("exp(-t/2e-3)", 4e-3, (-2.0_f64).exp()),
            ("-t^2", 3.0, -9.0),
            ("1-t^2/4", 1.0, 0.75),
            ("(-t)^2", 3.0, 9.0),
            ("2^-t", 3.0, 0.125),
            ("2^3^2", 0.0, 512.0),
            ("-2^2*3", 0.0, -12.0),
            ("2*-t", 3.0, -6.0),
            ("--t - +t", 3.0, 0.0),
            ("-+t", 3.0, -3.0),
            ("2*+-+t", 3.0, -6.0),
            ("min(1, t/0.1)", 0.05, 0.5),
            ("max(0, t - 1)", 0.5, 0.0),
            ("step(t-1)*t", 2.0, 2.0),
            ("3", 7.0, 3.0),
            ("8/2*t", 3.0, 12.0),
            ("8/2/t", 2.0, 2.0),
            ("1 - 2 + t - 3", 10.0, 6.0),
            ("sin(t)^2 + cos(t)^2", 0.7, 1.0),
            ("1E2 + .5 + 1.5e+1", 0.0, 115.5),
            (" ( ( t ) ) ", 4.0, 4.0),
            ("atan2(t, PI)", 0.0, 0.0),
        ] {
            assert!((at(text, t) - wanted).abs() < 1e-14, "{text}: {}", at(text, t));
        }
    }

    #[test]
    fn profiles_are_expressions_of_the_place() {
        let wanted = 2.0_f64.mul_add(1.5, (-0.25_f64).exp());
        let read = profile("load[0].profile", "2*z + exp(-(x-y)^2)").expect("a profile");
        assert!((read(&Point3::new(1.0, 0.5, 1.5)) - wanted).abs() < 1e-14);
        let refused = profile("load[0].profile", "t")
            .err()
            .expect("no time")
            .to_string();
        assert!(
            refused.contains("load[0].profile") && refused.contains("knows x, y and z"),
            "{refused}"
        );
    }

    #[test]
    fn what_is_no_expression_is_refused_with_what_is_wrong() {
        let deep = "(".repeat(200) + "t" + &")".repeat(200);
        let high = "2^".repeat(200) + "t";
        for (text, words) in [
            ("x + 1", "knows no 'x'"),
            ("foo(t)", "it knows t, the time in s, pi, sin, cos"),
            ("sin t", "functions with brackets behind them"),
            ("sin(", "ends where a number"),
            ("sin(t", "lacks a closing bracket"),
            ("(t + 1]", "has ']' where a bracket should close"),
            ("", "ends where a number"),
            ("2t", "has 't' where it should go on"),
            ("2 3", "has '3' where it should go on"),
            ("1.2.3", "has '1.2.3', which is no number"),
            ("1e", "has '1e', which is no number"),
            ("t +", "ends where a number"),
            ("t * / 2", "has '/' where a number"),
            ("min(t)", "takes two"),
            ("é", "has 'é' where a number"),
            (&deep, "nested more than 100 deep"),
            (&high, "nested more than 100 deep"),
        ] {
            let message = formula("load[0].time", text).expect_err(text).to_string();
            assert!(
                message.contains(words) && message.contains("load[0].time.expression"),
                "{message}"
            );
        }
    }
}
