//! Writes a proposal into the scene file and keeps its comments.

use super::choose::{self, Prospect, rounded};
use super::predict::Candidate;
use super::scenario::{OverlapKind, Scenario};
use crate::error::{Error, Result, key, value, write as write_error};
use crate::scene::{Scene, Source};
use crate::setup::{LoweredScene, OverlapSource};
use crate::spec::{JunctionKind, OverlapShape, ProfileKind, RegionShape, Shape};
use arlequin::core::advice;
use std::f64::consts::SQRT_2;
use std::path::Path;
use toml_edit::{DocumentMut, Item, Table, TableLike, Value};

/// One change of a scene.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Change {
    /// Path of the key.
    pub path: String,
    /// New value as TOML; `None` to remove the key.
    pub text: Option<String>,
}

impl Change {
    fn new(path: impl Into<String>, text: impl Into<String>) -> Self {
        Self {
            path: path.into(),
            text: Some(text.into()),
        }
    }

    /// Returns the change as an argument of `--set`; without a value, it removes the key.
    pub(super) fn assignment(&self) -> String {
        format!("{}={}", self.path, self.text.as_deref().unwrap_or_default())
    }
}

/// Returns whether enough energy lies above the coarse cutoff to be worth an absorber: more than a tenth of
/// the square of the predicted error.
pub(super) fn needs_absorber(p: &Prospect) -> bool {
    // Energies compare with the square of an error.
    p.errors.above_cutoff > 0.1 * p.errors.worst().powi(2)
}

/// Returns the width of the overlap in coarse elements, and the fine spacings in one of them.
pub(super) fn proportions(s: &Scenario, p: &Prospect) -> [f64; 2] {
    let c = &p.candidate;
    let elements = s.mesher.elements(c.spacing);
    let edge = elements.map_or(c.h, |e| choose::edge(s, &e));
    [c.overlap / edge, edge / c.r]
}

/// Returns whether an absorber works in the overlap of a proposal: in narrow overlaps, and with a fine model
/// hardly finer than the coarse one, much of the short waves comes back.
pub(super) fn absorber_works(s: &Scenario, p: &Prospect) -> bool {
    let [width, ratio] = proportions(s, p);
    let jump = if p.candidate.profile == ProfileKind::Constant {
        0.5
    } else {
        0.0
    };
    advice::absorber(Some(width), jump, 1.0, 1.0 / ratio).is_empty()
}

/// Formats a spacing.
fn number(x: f64) -> String {
    format!("{:e}", rounded(x))
}

/// Formats a length.
fn digits(x: f64) -> String {
    format!("{:e}", tidy(x))
}

/// Rounds a length to ten digits.
fn tidy(x: f64) -> f64 {
    format!("{x:.9e}").parse().unwrap_or(x)
}

fn counts(lengths: &[f64], spacing: f64) -> String {
    let n: Vec<String> = lengths
        .iter()
        // A quotient that is whole up to round-off needs no further element.
        .map(|l| (l / spacing - 1e-6).ceil().max(1.0).to_string())
        .collect();
    format!("[{}]", n.join(", "))
}

/// Returns the changes that turn the scene into the proposal.
pub(super) fn changes(scene: &LoweredScene, s: &Scenario, p: &Prospect, fraction: f64) -> Vec<Change> {
    let c = &p.candidate;
    let table = &s.keys[1];
    let mut out = Vec::new();
    if *c != choose::as_given(s).0 {
        out.extend(overlap(scene, s, c));
    }
    if needs_absorber(p) && !s.absorber && absorber_works(s, p) {
        out.push(Change::new(format!("{table}.absorber.rate_factor"), "0.2"));
    }
    if s.fraction.is_none_or(|f| (f - fraction).abs() > 1e-9) {
        out.push(Change::new("time.step", format!("{{ fraction = {fraction} }}")));
    }
    out
}

/// Returns the changes of spacings and overlap.
fn overlap(scene: &LoweredScene, s: &Scenario, c: &Candidate) -> Vec<Change> {
    let table = &s.keys[1];
    let joint = scene.interface.get(&s.names[0]);
    let mut out = vec![coarse(scene, s, c)];
    out.extend(mediator(scene, s, c));
    if s.kind == OverlapKind::Slab {
        let profile = format!("\"{}\"", c.profile);
        out.push(Change::new(format!("{table}.weight.profile"), profile));
    }
    if s.kind == OverlapKind::Slab && joint.is_some_and(|j| j.weight.value.is_some()) {
        // Other profiles refuse the value of the constant profile.
        out.push(Change {
            path: format!("{table}.weight.value"),
            text: None,
        });
    }
    // The junction L2 has no length.
    if let Some(l) = c.length_ratio.filter(|_| s.junction != JunctionKind::L2) {
        out.push(Change::new(format!("{table}.junction.length"), number(l * c.h_b)));
    }
    if s.movable {
        out.extend(match s.kind {
            OverlapKind::Slab => move_slab(scene, s, c.overlap),
            OverlapKind::Shell => move_shell(scene, s, c.overlap),
            OverlapKind::Zone => vec![Change::new(format!("{table}.overlap.width"), digits(c.overlap))],
        });
    }
    out
}

/// Returns the change of the coarse elements.
fn coarse(scene: &LoweredScene, s: &Scenario, c: &Candidate) -> Change {
    let path = &s.keys[0];
    let divided = s.coarse_table(scene).is_some_and(|m| m.divisions.is_some());
    match s.mesher.elements(c.spacing).filter(|_| divided) {
        Some(e) => Change::new(format!("{path}.divisions"), format!("{:?}", e.counts)),
        None => Change::new(format!("{path}.spacing"), number(c.spacing)),
    }
}

/// Returns the change of the mediator, if it needs one.
fn mediator(scene: &LoweredScene, s: &Scenario, c: &Candidate) -> Option<Change> {
    let table = &s.keys[1];
    if s.kind == OverlapKind::Zone {
        // The mediator consists of the body's elements: only a finer one needs a spacing, or a spacing that
        // the scene gives. Elements are halved until they are no longer, so that half-way between two
        // halvings the number is sure in spite of elements of several lengths.
        let given = scene.zone.get(&s.names[0])?.mediator.spacing;
        let longest = SQRT_2 * c.h_b * s.stretch;
        return (c.h_b < (1.0 - 1e-6) * c.h || given.is_some())
            .then(|| Change::new(format!("{table}.mediator.spacing"), number(longest)));
    }
    let given = &scene.interface.get(&s.names[0])?.mediator;
    Some(if given.divisions.is_some() {
        let along = |a: f64| (0..3).map(|k| if k == s.axis { c.overlap } else { a }).collect();
        let lengths: Vec<f64> = s.across.map_or_else(|| vec![c.overlap], along);
        Change::new(format!("{table}.mediator.divisions"), counts(&lengths, c.h_b))
    } else {
        // In proportion to the spacing as it is written, so that both are rounded alike across the body.
        let spacing = c.h_b / c.h * c.spacing;
        Change::new(format!("{table}.mediator.spacing"), number(spacing))
    })
}

/// Returns the changes that move the overlap's border to the coarse model and the end of the fine body, which
/// lie at one place.
fn move_slab(scene: &LoweredScene, s: &Scenario, overlap: f64) -> Vec<Change> {
    let fine = &s.names[2];
    let place = tidy(s.border + s.inward * overlap);
    let point = |mut x: [f64; 3]| {
        x[s.axis] = place;
        format!("[{:e}, {:e}, {:e}]", x[0], x[1], x[2])
    };
    let mut out = Vec::new();
    let overlap = scene.interface.get(&s.names[0]).map(|i| &i.overlap);
    if let Some(OverlapSource::Given(OverlapShape::Slab { coarse, .. })) = overlap {
        out.push(Change::new(
            format!("{}.overlap.slab.coarse", s.keys[1]),
            point(*coarse),
        ));
    }
    let shape = format!("model.{fine}.shape");
    let up = s.inward > 0.0;
    match scene.model.get(fine).and_then(|m| m.shape.in_scene()) {
        Some(Shape::Box { low, high, .. }) => {
            let (name, corner) = if up { ("high", high) } else { ("low", low) };
            out.push(Change::new(format!("{shape}.box.{name}"), point(*corner)));
        }
        Some(Shape::Bar { .. }) => {
            let name = if up { "to" } else { "from" };
            out.push(Change::new(format!("{shape}.bar.{name}"), format!("{place:e}")));
        }
        Some(Shape::Cylinder { from, length, .. }) => {
            let (start, end) = if up {
                (from[0], place)
            } else {
                // The other end of the cylinder stays.
                out.push(Change::new(format!("{shape}.cylinder.from"), point(*from)));
                (place, from[0] + length)
            };
            let length = format!("{:e}", tidy(end - start));
            out.push(Change::new(format!("{shape}.cylinder.length"), length));
        }
        _ => {}
    }
    out
}

/// Returns the changes that move the outer border of a shell and the end of the fine body, which lie at one
/// place.
fn move_shell(scene: &LoweredScene, s: &Scenario, width: f64) -> Vec<Change> {
    let (Some(joint), Some(fine)) = (scene.interface.get(&s.names[0]), scene.model.get(&s.names[2])) else {
        return Vec::new();
    };
    let OverlapSource::Given(OverlapShape::Shell { core, domain }) = &joint.overlap else {
        return Vec::new();
    };
    let paths = [
        format!("{}.overlap.shell.domain", s.keys[1]),
        format!("model.{}.shape", s.names[2]),
    ];
    match (core, domain, fine.shape.in_scene()) {
        (RegionShape::Ball { radius, .. }, ..) => paths
            .map(|p| Change::new(format!("{p}.ball.radius"), digits(radius + width)))
            .to_vec(),
        (
            RegionShape::Box { low: a, high: b },
            RegionShape::Box { low: l, high: h },
            Some(Shape::Box { low, high, .. }),
        ) => {
            let point = |x: [f64; 3]| format!("[{:e}, {:e}, {:e}]", x[0], x[1], x[2]);
            // Faces at which the shell is open stay.
            let lower =
                |x: &[f64; 3]| point([0, 1, 2].map(|c| if l[c] < a[c] { tidy(a[c] - width) } else { x[c] }));
            let upper =
                |x: &[f64; 3]| point([0, 1, 2].map(|c| if h[c] > b[c] { tidy(b[c] + width) } else { x[c] }));
            let corners = [(&paths[0], [l, h]), (&paths[1], [low, high])];
            let moved = |(p, [l, h]): (&String, [&[f64; 3]; 2])| {
                [
                    Change::new(format!("{p}.box.low"), lower(l)),
                    Change::new(format!("{p}.box.high"), upper(h)),
                ]
            };
            corners.into_iter().flat_map(moved).collect()
        }
        _ => Vec::new(),
    }
}

/// Writes the scene with its earlier `--set` values and the changes; everything else stays as it is, comments
/// included.
pub(super) fn write(scene: &Scene, changes: &[Change], out: &Path) -> Result<()> {
    if out.exists() {
        let rule = "exists; choose another name, nothing is overwritten";
        return Err(value("--apply", out.display(), rule));
    }
    let mut document: DocumentMut =
        scene
            .source()
            .text
            .parse()
            .map_err(|e: toml_edit::TomlError| Error::Syntax {
                message: e.message().to_owned(),
                span: e.span(),
            })?;
    // Earlier values come first, so that a change of the same key wins.
    let earlier = scene
        .changes()
        .iter()
        .filter_map(|s| s.split_once('='))
        .map(|(p, v)| Change::new(p.trim(), v.trim()));
    for change in earlier.chain(changes.iter().cloned()) {
        put(&mut document, &change)?;
    }
    // Reading the text again makes sure that it is a scene.
    let written = Scene::from_source(Source::new(out, document.to_string()))?;
    std::fs::write(out, &written.source().text).map_err(write_error(out))
}

fn put(document: &mut DocumentMut, change: &Change) -> Result<()> {
    let (head, last) = change.path.rsplit_once('.').unwrap_or(("", &change.path));
    let mut table: &mut dyn TableLike = document.as_table_mut();
    for part in head.split('.').filter(|p| !p.is_empty()) {
        let item = table.entry(part).or_insert_with(|| Item::Table(Table::new()));
        table = item.as_table_like_mut().ok_or_else(|| {
            let rule = format!(
                "'{part}' is a list or a plain value, which --apply cannot reach into; change the file"
            );
            key(change.path.clone(), rule)
        })?;
    }
    let Some(text) = &change.text else {
        table.remove(last);
        return Ok(());
    };
    // As for `--set`, a word without quotes is a string.
    let mut new = text
        .parse::<Value>()
        .unwrap_or_else(|_| Value::from(text.as_str()));
    match table.get_mut(last) {
        // A value that stays keeps its spelling.
        Some(Item::Value(old)) if is_equal(old, &new) => {}
        Some(Item::Value(old)) => {
            // The decor holds spaces and the comment behind the value.
            *new.decor_mut() = old.decor().clone();
            *old = new;
        }
        Some(other) => *other = Item::Value(new),
        None => {
            table.insert(last, Item::Value(new));
        }
    }
    Ok(())
}

/// Returns whether two values are equal, however they are written.
fn is_equal(a: &Value, b: &Value) -> bool {
    match (a.as_float(), b.as_float()) {
        (Some(x), Some(y)) => x.total_cmp(&y).is_eq(),
        _ => {
            // Reading both as data makes spelling irrelevant.
            let plain =
                |v: &Value| toml::from_str::<toml::Table>(&format!("x = {}", v.to_string().trim())).ok();
            plain(a) == plain(b)
        }
    }
}
