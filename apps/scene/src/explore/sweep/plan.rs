//! Turns a sweep file into the list of its runs.

use crate::error::{Result, key, unknown, value};
use crate::scene::{Scene, Source};
use crate::spec::sweep::{Axis, Design, Mark, Reference, SweepFile};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// One run of a sweep.
#[derive(Debug, Clone)]
pub struct Member {
    /// Name of the run and of its folder.
    pub label: String,
    /// Mark of an all-fine or all-coarse run.
    pub mark: Option<Mark>,
    /// True for a run along the axes, false for a named run.
    pub swept: bool,
    /// Values by axis, as text.
    pub parameters: BTreeMap<String, String>,
    /// Scene file.
    pub scene: PathBuf,
    /// Texts of the scene and of the meshes it reads.
    pub text: String,
    /// Assignments; those of the sweep itself come last.
    pub set: Vec<String>,
    /// Role of each model: fine, coarse or none.
    pub roles: BTreeMap<String, Option<&'static str>>,
}

/// One value of an axis.
#[derive(Debug, Clone)]
struct Choice {
    name: String,
    set: Vec<String>,
}

/// An axis, its chosen value, and true if this is not the base value.
type Picked<'a> = (&'a String, &'a Choice, bool);

/// Returns all runs of a sweep: the reference first, then named runs, then those along the axes.
pub(super) fn members(file: &SweepFile, folder: &Path) -> Result<Vec<Member>> {
    check(file)?;
    let axes: Vec<(&String, Vec<Choice>, usize)> = file
        .axis
        .iter()
        .map(|(name, axis)| {
            let choices = choices(name, axis)?;
            let base = base(name, axis, &choices)?;
            Ok((name, choices, base))
        })
        .collect::<Result<_>>()?;
    let mut out = named_runs(file, folder)?;
    let scene = folder.join(&file.scene);
    for picked in combinations(file.design, &axes) {
        let mut chosen: Vec<Picked<'_>> = axes
            .iter()
            .zip(&picked)
            .map(|((n, c, base), k)| (*n, &c[*k], k != base))
            .collect();
        if file.design == Design::OneAtATime {
            // The varied axis comes last, so that base values of other axes do not overwrite its assignments.
            chosen.sort_by_key(|c| c.2);
        }
        let label: Vec<String> = chosen
            .iter()
            .filter(|c| c.2 || file.design == Design::Product)
            .map(|(n, c, _)| format!("{n}={}", c.name))
            .collect();
        let label = if label.is_empty() {
            "base".to_owned()
        } else {
            label.join(",")
        };
        let mut set = file.set.clone();
        set.extend(chosen.iter().flat_map(|(_, c, _)| c.set.clone()));
        let parameters = chosen.iter().map(|(n, c, _)| ((*n).clone(), c.name.clone()));
        let mut m = member("axis", &label, &scene, set, parameters.collect())?;
        m.swept = true;
        out.push(m);
    }
    check_labels(&out)?;
    reference_first(file, &mut out)?;
    Ok(out)
}

/// Returns the named runs.
fn named_runs(file: &SweepFile, folder: &Path) -> Result<Vec<Member>> {
    let mut out = Vec::new();
    for (name, run) in &file.run {
        let (scene, common) = match &run.scene {
            // The common assignments belong to the base scene; another may not have their keys.
            Some(s) => (folder.join(s), &[][..]),
            None => (folder.join(&file.scene), file.set.as_slice()),
        };
        let place = format!("run.{name}");
        let versions = if run.values.is_empty() {
            vec![(name.clone(), None, run.set.clone())]
        } else {
            let filled = run.values.iter().enumerate().map(|(k, v)| {
                let (text, set) = fill(&format!("{place}.values[{k}]"), v, &run.set)?;
                Ok((format!("{name}={text}"), Some(text), set))
            });
            filled.collect::<Result<_>>()?
        };
        for (label, text, set) in versions {
            let parameters = text.map(|t| (name.clone(), t)).into_iter().collect();
            let set = common.iter().cloned().chain(set).collect();
            let mut m = member(&place, &label, &scene, set, parameters)?;
            m.mark = run.mark;
            out.push(m);
        }
    }
    Ok(out)
}

fn check(file: &SweepFile) -> Result<()> {
    if file.repeat == 0 {
        return Err(value("repeat", 0, "must be at least 1"));
    }
    if file.threads == Some(0) {
        return Err(value("threads", 0, "must be at least 1"));
    }
    for (k, t) in file.targets.iter().enumerate() {
        if !(*t > 0.0 && t.is_finite()) {
            return Err(value(
                format!("targets[{k}]"),
                t,
                "must be a positive error, such as 0.02",
            ));
        }
    }
    for (name, r) in &file.reflected {
        if r.after.is_nan() || r.after <= 0.0 || r.until.is_some_and(|u| u.is_nan() || u <= r.after) {
            let rule =
                "must be positive and before until [s]: it separates what goes in from what comes back";
            return Err(value(format!("reflected.{name}.after"), r.after, rule));
        }
        if r.minus_reference && file.reference.is_none() {
            let rule = "needs a [reference] to take off; add one or remove the key";
            return Err(key(format!("reflected.{name}.minus_reference"), rule));
        }
    }
    for (name, m) in &file.measure {
        let pointed = m.pointer.as_ref().is_some_and(|p| p.starts_with('/'));
        if m.pointer.is_some() == m.fact.is_some() || (m.pointer.is_some() && !pointed) {
            let rule = "needs exactly one of pointer, such as \"/probes/tip/max\", and fact, such as \"broken bonds\"";
            return Err(key(format!("measure.{name}"), rule));
        }
        if !(m.factor.is_finite() && m.factor.abs() > 0.0) {
            return Err(value(
                format!("measure.{name}.factor"),
                m.factor,
                "must be finite and not zero",
            ));
        }
    }
    match (file.errors.from, file.errors.to) {
        (Some(a), Some(b)) if a >= b => {
            return Err(value("errors.from", a, "must be before errors.to [s]"));
        }
        _ => {}
    }
    match &file.hook {
        Some(h) if !file.axis.contains_key(&h.axis) => {
            Err(unknown("hook.axis", &h.axis, "axis", file.axis.keys()))
        }
        _ => Ok(()),
    }
}

fn choices(name: &str, axis: &Axis) -> Result<Vec<Choice>> {
    let place = format!("axis.{name}");
    if axis.values.is_empty() == axis.levels.is_empty() {
        return Err(key(place, "needs exactly one of values (with set), levels"));
    }
    if !axis.levels.is_empty() {
        if !axis.set.is_empty() {
            return Err(key(
                place,
                "set belongs to values; every level has a set of its own",
            ));
        }
        let choice = |l: &crate::spec::sweep::Level| Choice {
            name: l.name.clone(),
            set: l.set.clone(),
        };
        return Ok(axis.levels.iter().map(choice).collect());
    }
    if axis.set.is_empty() {
        let rule = "needs set, a list such as [\"model.left.spacing={}\"], to say what the values change";
        return Err(key(place, rule));
    }
    let choice = |(k, v): (usize, &toml::Value)| {
        let (name, set) = fill(&format!("{place}.values[{k}]"), v, &axis.set)?;
        Ok(Choice { name, set })
    };
    axis.values.iter().enumerate().map(choice).collect()
}

fn base(name: &str, axis: &Axis, choices: &[Choice]) -> Result<usize> {
    let Some(wanted) = &axis.base else { return Ok(0) };
    let wanted = value_text(wanted);
    let index = choices.iter().position(|c| c.name == wanted);
    let names: Vec<String> = choices.iter().map(|c| c.name.clone()).collect();
    index.ok_or_else(|| unknown(format!("axis.{name}.base"), &wanted, "value", names.iter()))
}

/// Formats a value for labels and assignments.
fn value_text(v: &toml::Value) -> String {
    match v {
        toml::Value::String(s) => s.clone(),
        // Labels stay short: 2e-7 instead of 0.0000002.
        toml::Value::Float(x) if *x != 0.0 && !(1e-3..1e6).contains(&x.abs()) => format!("{x:e}"),
        // A list is named after its first entry.
        toml::Value::Array(a) => a.first().map(value_text).unwrap_or_default(),
        toml::Value::Float(x) => x.to_string(),
        toml::Value::Integer(n) => n.to_string(),
        toml::Value::Boolean(b) => b.to_string(),
        toml::Value::Datetime(_) | toml::Value::Table(_) => String::new(),
    }
}

/// Returns the name of a value, and the assignments with the value filled in.
fn fill(place: &str, v: &toml::Value, templates: &[String]) -> Result<(String, Vec<String>)> {
    let parts: Vec<String> = match v {
        toml::Value::Array(a) => a.iter().map(value_text).collect(),
        other => vec![value_text(other)],
    };
    let name = value_text(v);
    if name.is_empty() {
        return Err(key(place, "is empty; give a number, a word or a list of them"));
    }
    let set: Vec<String> = templates
        .iter()
        .map(|t| {
            let first = t.replace("{}", &parts[0]);
            let put = |s: String, (k, p): (usize, &String)| s.replace(&format!("{{{k}}}"), p);
            parts.iter().enumerate().fold(first, put)
        })
        .collect();
    let open = |s: &&String| {
        let digits = |rest: &str| {
            rest.split_once('}')
                .is_some_and(|(d, _)| !d.is_empty() && d.bytes().all(|b| b.is_ascii_digit()))
        };
        s.split('{').skip(1).any(digits)
    };
    if let Some(s) = set.iter().find(open) {
        let rule = format!("has {} entries, but '{s}' asks for more", parts.len());
        return Err(key(place, rule));
    }
    if set.as_slice() == templates {
        let rule = "changes nothing: no assignment of set contains {} or {0}";
        return Err(key(place, rule));
    }
    Ok((name, set))
}

/// Indices of the chosen values of all axes, one list per run.
fn combinations(design: Design, axes: &[(&String, Vec<Choice>, usize)]) -> Vec<Vec<usize>> {
    let base: Vec<usize> = axes.iter().map(|a| a.2).collect();
    match design {
        Design::Product => axes.iter().fold(vec![Vec::new()], |heads, (_, choices, _)| {
            let with = |head: &Vec<usize>| {
                let longer = |k| head.iter().copied().chain([k]).collect::<Vec<_>>();
                (0..choices.len()).map(longer).collect::<Vec<_>>()
            };
            heads.iter().flat_map(with).collect()
        }),
        Design::OneAtATime => {
            let mut runs = vec![base.clone()];
            for (a, (_, choices, base_choice)) in axes.iter().enumerate() {
                for k in (0..choices.len()).filter(|k| k != base_choice) {
                    let mut picked = base.clone();
                    picked[a] = k;
                    runs.push(picked);
                }
            }
            runs
        }
    }
}

fn member(
    place: &str,
    label: &str,
    scene: &Path,
    mut set: Vec<String>,
    parameters: BTreeMap<String, String>,
) -> Result<Member> {
    let named = |e: crate::error::Error| key(place, format!("run '{label}': {e}"));
    let source = Source::read(scene)?;
    let read = Scene::from_source(source)
        .and_then(|s| s.assign(&set))
        .map_err(named)?;
    let files = read.files();
    let (source, read) = (read.source(), read.spec());
    // Plots and frames would only cost time and space. A scene whose `--set` asks for them keeps them.
    let quiet = |set: &mut Vec<String>, name: &str, text: String| {
        if !set.iter().any(|s| s.starts_with(name)) {
            set.push(text);
        }
    };
    quiet(&mut set, "output.plots", "output.plots=false".into());
    if read.output.interval.is_some() {
        // Frames farther apart than the run is long.
        let end = read.time.end.unwrap_or(1.0).abs() * 1e3 + 1.0;
        quiet(&mut set, "output.interval", format!("output.interval={end:e}"));
    } else {
        quiet(&mut set, "output.every", "output.every=1000000000".into());
    }
    let mut text = source.text.clone();
    for path in files {
        // A mesh that cannot be read is an error of the run itself.
        let bytes = std::fs::read(source.folder.join(path)).unwrap_or_default();
        text += &String::from_utf8_lossy(&bytes);
    }
    let roles = read
        .model
        .iter()
        .map(|(n, m)| (n.clone(), m.role.map(crate::spec::RoleKind::name)));
    Ok(Member {
        label: folder_name(label),
        mark: None,
        swept: false,
        parameters,
        scene: scene.to_owned(),
        text,
        set,
        roles: roles.collect(),
    })
}

/// Replaces characters that file systems reject.
fn folder_name(label: &str) -> String {
    let good = |c: char| c.is_alphanumeric() || "=,.+-_".contains(c);
    label.chars().map(|c| if good(c) { c } else { '_' }).collect()
}

fn check_labels(members: &[Member]) -> Result<()> {
    let mut seen = BTreeSet::new();
    match members.iter().find(|m| !seen.insert(&m.label)) {
        Some(m) => Err(key(
            "axis",
            format!(
                "two runs are called '{}'; give their values or levels different names",
                m.label
            ),
        )),
        None => Ok(()),
    }
}

/// Moves the reference run to the front, so that a sweep that is interrupted has errors too.
fn reference_first(file: &SweepFile, members: &mut [Member]) -> Result<()> {
    let Some(Reference::Run(name)) = &file.reference else {
        return Ok(());
    };
    let name = folder_name(name);
    let Some(k) = members.iter().position(|m| m.label == name) else {
        let labels: Vec<String> = members.iter().map(|m| m.label.clone()).collect();
        return Err(unknown("reference.run", &name, "run", labels.iter()));
    };
    // Rotating keeps the order of the others.
    members[..=k].rotate_right(1);
    Ok(())
}
