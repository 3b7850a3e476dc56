//! Warnings about possible but improbable values. Each names the value; no value is refused.

use super::bounds::Bound;
use super::built::{Built, ModelInfo};
use super::drive;
use super::names::effect_models;
use super::shapes::corners;
use super::time::time_function;
use super::{particle_warnings, profile};
use crate::setup::{LoweredModel, LoweredScene, OverlapSource};
use crate::spec::{Effect, EffectKind, OverlapShape, RegionShape, TimeShape};
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::core::{OwnStep, ShapeRow, Subdomain, advice};
use std::collections::BTreeSet;

/// Number of steps above which a run is probably a mistake.
const MANY_STEPS: f64 = 1e9;

/// Young's moduli of solids \[Pa\]: from the softest gels to beyond diamond.
const YOUNG: [f64; 2] = [1e3, 2e12];
/// Densities of solids \[kg/m³\]: from the lightest foams to beyond osmium.
const DENSITY: [f64; 2] = [5.0, 3e4];
/// Largest plausible strain that a load gives a linearly elastic body \[–\].
const STRAIN: f64 = 0.1;
/// Largest plausible ratio of two Young's moduli in one overlap.
const STIFFNESS: f64 = 1000.0;
/// Number of coarse elements across an overlap below which long waves are reflected at its borders.
const ACROSS: f64 = 3.0;
/// Samples of a function of time within a run.
const SAMPLES: u32 = 1000;
/// Extent of a body \[m\] above which, and share of it crossed by a wave in the whole run below which,
/// lengths are probably in millimetres.
const MILLIMETRES: [f64; 2] = [1.0, 0.1];
/// Largest plausible overrun of the end, as a share of the run: a run makes whole steps.
const OVERRUN: f64 = 0.25;
/// Largest plausible overrun for models without own steps, whose whole steps are short.
const OVERRUN_ALONE: f64 = 1.0;
/// Largest number of cells of one model that are searched for in another.
const LOOKS: usize = 2000;

/// Returns all warnings about a scene that has been built.
pub(super) fn warnings(scene: &LoweredScene, built: &Built) -> Vec<String> {
    let mut out = Vec::new();
    // A unit material means that the scene has its own units of length, time and load; only ratios can then
    // be odd.
    let is_one = |x: f64| x.to_bits() == 1.0_f64.to_bits();
    let unit = |m: &LoweredModel| m.material.is_some_and(|m| is_one(m.young) && is_one(m.density));
    if !scene.model.values().any(unit) {
        scene
            .model
            .iter()
            .for_each(|(name, table)| materials(name, table, &mut out));
        particle_warnings::strengths(scene, &mut out);
        out.extend(millimetres(built));
    }
    for (m, (name, table)) in scene.model.iter().enumerate() {
        out.extend(particle_warnings::coordination(
            name,
            table,
            built.models[m].breaks.is_some(),
        ));
        if let (true, Some(nu)) = (table.shape.is_line(), table.material.and_then(|m| m.poisson)) {
            out.push(format!(
                "model '{name}': material.poisson = {nu} does not enter: a line has no width; remove it"
            ));
        }
    }
    out.extend(particle_warnings::rare_checks(scene, built));
    loads(scene, built, &mut out);
    out.extend(profile::warnings(scene, end(built)));
    let last = built.run.time() + built.steps as f64 * built.run.dt();
    out.extend(drive::wide_turns(scene, last));
    overlaps(scene, built, &mut out);
    untied(scene, built, &mut out);
    out.extend(steps(built));
    own_steps(scene, built, &mut out);
    out.extend(beyond_the_end(scene, built));
    out.extend(built.bounds.watch(&built.run));
    out
}

/// Returns "far below" or "far above" if the value lies outside of a range.
pub(super) fn far_outside(x: f64, [low, high]: [f64; 2]) -> Option<&'static str> {
    match x {
        x if x < low => Some("far below"),
        x if x > high => Some("far above"),
        _ => None,
    }
}

fn materials(name: &str, table: &LoweredModel, out: &mut Vec<String>) {
    let values = [
        ("material.young", table.material.map(|m| m.young), "Pa", YOUNG),
        (
            "material.density",
            table.material.map(|m| m.density),
            "kg/m³",
            DENSITY,
        ),
        // Beams are stiffer than the body that they form.
        ("dem.young", table.dem.young, "Pa", [YOUNG[0], 10.0 * YOUNG[1]]),
    ];
    for (key, x, unit, range) in values {
        let Some(x) = x else { continue };
        if let Some(far) = far_outside(x, range) {
            out.push(format!(
                "model '{name}': {key} = {x:e} {unit} is {far} that of any solid ({:e} to {:e} {unit}); check the unit",
                range[0], range[1]
            ));
        }
    }
}

fn millimetres(built: &Built) -> Option<String> {
    // No wave runs in a `[static]` scene.
    if built.load_steps.is_some() {
        return None;
    }
    let end = built.steps as f64 * built.run.dt();
    let bounded = built.run.subdomains().iter().zip(&built.bounds.0);
    let odd = |(_, b): &(&Subdomain<f64>, &Bound)| {
        b.extent >= MILLIMETRES[0] && b.wave * end < MILLIMETRES[1] * b.extent
    };
    bounded.into_iter().find(odd).map(|(s, b)| {
        format!(
            "model '{}': is {:.3e} m long, and a wave crosses {:.1e} of it in the whole run; lengths are metres: check that \
             they are not given in millimetres, or run longer",
            s.model().name(),
            b.extent,
            b.wave * end / b.extent
        )
    })
}

/// Warns about large stresses from loads and body forces, estimated from the size of the body.
fn loads(scene: &LoweredScene, built: &Built, out: &mut Vec<String>) {
    let size = |v: [f64; 3]| Vector3::from(v).norm();
    let names: Vec<&String> = scene.model.keys().collect();
    let mut judge = |what: String, model: usize, stress: f64| {
        let Some(young) = built.models[model].material.map(|m| m.young()) else {
            return;
        };
        if stress > STRAIN * young {
            out.push(format!(
                "{what}: gives model '{}' a stress of about {stress:.1e} Pa, a strain of {:.1e}, which no linear elasticity \
                 bears; check the unit",
                names[model],
                stress / young
            ));
        }
    };
    for (k, l) in scene.load.iter().enumerate() {
        let Some(m) = names.iter().position(|n| **n == l.model) else {
            continue;
        };
        let area = built.bounds.0[m].section;
        let [factor, _] = peaks(&l.time, built);
        let (what, stress) = match (l.force, l.torque, l.traction, l.pressure) {
            (Some(f), ..) => (format!("force of {:.3e} N", factor * size(f)), size(f) / area),
            (_, Some(t), ..) => (
                format!("torque of {:.3e} N m", factor * size(t)),
                // The order of magnitude: a section modulus has the size of area^(3/2).
                size(t) / area.powf(1.5),
            ),
            (_, _, Some(t), _) => (format!("traction of {:.3e} Pa", factor * size(t)), size(t)),
            (_, _, _, p) => {
                let p = p.unwrap_or_default().abs();
                (format!("pressure of {:.3e} Pa", factor * p), p)
            }
        };
        judge(format!("load[{k}]: a {what}"), m, factor * stress);
    }
    for (k, e) in scene.effect.iter().enumerate().filter(|(_, e)| e.enabled) {
        let EffectKind::BodyForce(b) = &e.kind else {
            continue;
        };
        let a = size(b.acceleration);
        for m in effect_models(k, e, scene).unwrap_or_default() {
            let Some(material) = built.models[m].material else {
                continue;
            };
            let stress = material.density() * a * built.bounds.0[m].extent;
            judge(format!("effect[{k}]: an acceleration of {a:.3e} m/s²"), m, stress);
        }
    }
    prescribed(scene, built, &names, out);
}

/// Last instant of the run, or of the load steps \[s\].
fn end(built: &Built) -> f64 {
    match &built.load_steps {
        Some(l) => l.times.last().copied().unwrap_or_default(),
        None => built.run.time() + built.steps as f64 * built.run.dt(),
    }
}

/// Returns the largest size of a function of time, and of its slope \[1/s\], that of a jump left out.
/// Formulas and tables are judged up to the end of the run, formulas as linear between samples.
fn peaks(shape: &TimeShape, built: &Built) -> [f64; 2] {
    let end = end(built);
    let mut times: Vec<f64> = (0..=SAMPLES)
        .map(|k| end * f64::from(k) / f64::from(SAMPLES))
        .collect();
    match shape {
        TimeShape::Step => return [1.0, 0.0],
        TimeShape::Ramp { duration } => return [1.0, 1.0 / duration],
        TimeShape::Pulse { duration } => return [1.0, std::f64::consts::PI / duration],
        TimeShape::Table(rows) => times.extend(rows.iter().map(|r| r.0).filter(|t| (0.0..=end).contains(t))),
        TimeShape::File(_) | TimeShape::Expression(_) => {}
    }
    let Ok(function) = time_function("time", shape) else {
        return [0.0; 2];
    };
    times.sort_unstable_by(f64::total_cmp);
    times.dedup();
    let values: Vec<f64> = times.iter().map(|t| function.value(*t)).collect();
    let slopes = times.windows(2).zip(values.windows(2));
    let slopes = slopes.map(|(t, v)| ((v[1] - v[0]) / (t[1] - t[0])).abs());
    [
        values.iter().fold(0.0, |m: f64, v| v.abs().max(m)),
        slopes.fold(0.0, f64::max),
    ]
}

/// Warns about prescribed motions larger than the body or faster than its waves.
fn prescribed(scene: &LoweredScene, built: &Built, names: &[&String], out: &mut Vec<String>) {
    let supports = scene.support.iter().enumerate();
    for (k, s) in supports {
        let (Some(m), Some(motion)) = (names.iter().position(|n| **n == s.model), &s.motion) else {
            continue;
        };
        let bound = &built.bounds.0[m];
        let [factor, rate] = peaks(&motion.time, built);
        let amplitude = factor * motion.amplitude.unwrap_or_default().abs();
        if bound.small && amplitude > bound.extent {
            out.push(format!(
                "support[{k}]: a motion of {amplitude:.3e} m is beyond model '{}', which is {:.3e} m large; check the unit",
                s.model, bound.extent
            ));
        }
        if scene.statics.is_some() {
            continue;
        }
        let speed = match (motion.speed, motion.amplitude) {
            (Some(speed), _) => factor * speed.abs(),
            (None, amplitude) => rate * amplitude.unwrap_or_default().abs(),
        };
        if speed > bound.wave {
            out.push(format!(
                "support[{k}]: a motion at {:.3e} m/s is faster than the waves of model '{}', {:.3e} m/s; check amplitude and \
                 duration",
                speed,
                s.model,
                bound.wave
            ));
        }
    }
}

/// Warns about overlaps of models with very different stiffness, and about overlaps of few elements.
fn overlaps(scene: &LoweredScene, built: &Built, out: &mut Vec<String>) {
    let info = |name: &String| {
        scene
            .model
            .keys()
            .position(|k| k == name)
            .map(|m| &built.models[m])
    };
    for (name, i) in &scene.interface {
        let (Some(coarse), Some(fine)) = (info(&i.coarse), info(&i.fine)) else {
            continue;
        };
        let ratio = match (coarse.material, fine.material) {
            (Some(a), Some(b)) => (a.young() / b.young()).max(b.young() / a.young()),
            _ => 1.0,
        };
        if ratio > STIFFNESS {
            out.push(format!(
                "interface '{name}': Young's moduli of '{}' and '{}' are {ratio:.1e} times apart in one place; check their \
                 units",
                i.coarse, i.fine
            ));
        }
        let Some(width) = width(&i.overlap) else { continue };
        // A mesh can be finer in one place than in another.
        let spacing = match &i.overlap {
            OverlapSource::Zone(piece) => piece.width().map_or(coarse.spacing, |w| w.spacing),
            OverlapSource::Given(OverlapShape::Slab { fine, coarse: far }) => {
                let ends = [Point3::from(*far), Point3::from(*fine)];
                coarse.grid.extent_across(ends).unwrap_or(coarse.spacing)
            }
            OverlapSource::Given(OverlapShape::Shell { .. }) => coarse.spacing,
        };
        let elements_across = width / spacing;
        // A zone's overlap consists of whole elements, whose mean size is only an estimate: 2.8 are three.
        let least = match &i.overlap {
            OverlapSource::Zone(_) => ACROSS - 0.5,
            OverlapSource::Given(_) => ACROSS * (1.0 - 1e-6),
        };
        if elements_across < least {
            // Steps of the zone's border make the layer narrower than `overlap.width`, wherever it ends.
            let remedy = match scene.zone.get(name).map(|z| z.overlap.width) {
                Some(asked) => format!(
                    "zone.{name}.overlap.width = {asked:e} is cut short by the border's corners: give {:.2e}",
                    asked + ACROSS * spacing - width
                ),
                None => format!("make it {:.3e} m wide or wider", ACROSS * spacing),
            };
            out.push(format!(
                "interface '{name}': its overlap of {width:.3e} m is {elements_across:.1} elements of '{}' ({spacing:.3e} m) across, \
                 which reflects waves; {remedy}",
                i.coarse
            ));
        }
    }
}

/// Distance between the two borders of an overlap \[m\]; `None` if it has no single value.
fn width(overlap: &OverlapSource) -> Option<f64> {
    let overlap = match overlap {
        OverlapSource::Zone(piece) => return piece.width().map(|w| w.mean),
        OverlapSource::Given(overlap) => overlap,
    };
    match overlap {
        OverlapShape::Slab { fine, coarse } => Some((Vector3::from(*coarse) - Vector3::from(*fine)).norm()),
        OverlapShape::Shell { core, domain } => match (core, domain) {
            (RegionShape::Ball { centre: a, radius: r }, RegionShape::Ball { centre: b, radius: s }) => {
                Some(s - r - (Vector3::from(*b) - Vector3::from(*a)).norm())
            }
            (
                RegionShape::Cylinder {
                    point: a,
                    radius: r,
                    axis,
                },
                RegionShape::Cylinder {
                    point: b, radius: s, ..
                },
            ) => {
                let apart = Vector3::from(*b) - Vector3::from(*a);
                Some(s - r - Vector3::from(*axis).normalize().cross(&apart).norm())
            }
            // Sides on which the inner box reaches the outer one do not count.
            (RegionShape::Box { low: a, high: b }, RegionShape::Box { low: c, high: d }) => (0..3)
                .flat_map(|k| [a[k] - c[k], d[k] - b[k]])
                .filter(|gap| *gap > 0.0)
                .reduce(f64::min),
            _ => None,
        },
    }
}

/// Warns about models that fill the same space without interface or contact.
fn untied(scene: &LoweredScene, built: &Built, out: &mut Vec<String>) {
    let names: Vec<&String> = scene.model.keys().collect();
    let tied = |a: &String, b: &String| {
        let pair = |x: &String, y: &String| (x == a && y == b) || (x == b && y == a);
        let by_interface = scene.interface.values().any(|i| pair(&i.coarse, &i.fine));
        let by_contact = |e: &Effect| {
            e.enabled
                && e.between
                    .as_ref()
                    .is_some_and(|n| n.len() == 2 && pair(&n[0], &n[1]))
        };
        by_interface || scene.effect.iter().any(by_contact)
    };
    for (b, second) in names.iter().enumerate() {
        for (a, first) in names[..b]
            .iter()
            .enumerate()
            .filter(|(_, first)| !tied(first, second))
        {
            let share =
                inside(&built.models[a], &built.models[b]).max(inside(&built.models[b], &built.models[a]));
            if share > 0.0 {
                out.push(format!(
                    "models '{first}' and '{second}' overlap ({:.1} % of one lies in the other) and no [interface] ties them: \
                     their mass and stiffness count twice there, and waves pass through unseen; add an interface, or trim one",
                    100.0 * share
                ));
            }
        }
    }
}

/// Share of the cells of a model whose centre lies in another model, estimated from a sample.
fn inside(model: &ModelInfo, other_model: &ModelInfo) -> f64 {
    let ([low, high], [from, to]) = (corners(&model.grid.points), corners(&other_model.grid.points));
    let apart = |c: usize| low[c] > to[c] || high[c] < from[c];
    let cells = model.grid.cells();
    if (0..3).any(apart) || cells == 0 {
        return 0.0;
    }
    let every = cells.div_ceil(LOOKS);
    let mut row = ShapeRow::default();
    let cells = model
        .grid
        .connectivity
        .chunks_exact(model.grid.corners)
        .step_by(every);
    let (mut hits, mut samples) = (0, 0);
    for cell in cells {
        let sum = cell
            .iter()
            .fold(Vector3::zeros(), |s, &k| s + model.grid.points[k as usize].coords);
        let centre = Point3::from(sum / cell.len() as f64);
        let near = (0..3).all(|c| centre[c] >= from[c] && centre[c] <= to[c]);
        samples += 1;
        hits += usize::from(near && other_model.field.shape_at(&centre, false, &mut row).is_ok());
    }
    f64::from(hits as u32) / f64::from(samples)
}

fn steps(built: &Built) -> Option<String> {
    let (n, dt) = (built.steps as f64, built.run.dt());
    (n > MANY_STEPS).then(|| {
        format!(
            "time: {n:.2e} steps of {dt:.2e} s are more than {MANY_STEPS:e}; choose an earlier end, or coarser models"
        )
    })
}

/// Warns about own steps that differ from the requested ones, or that are too long for what the mesh
/// resolves.
fn own_steps(scene: &LoweredScene, built: &Built, out: &mut Vec<String>) {
    // A `[static]` scene makes no time steps.
    if built.load_steps.is_some() {
        return;
    }
    let subdomains = built.run.subdomains().iter().zip(built.run.critical_steps());
    for (s, critical) in subdomains {
        let (name, own_steps) = (s.model().name(), s.own_steps());
        match s.step_choice() {
            OwnStep::Ratio(asked) if asked != own_steps => {
                let acts = |e: &&Effect| e.between.as_ref().is_some_and(|b| b.iter().any(|n| n == name));
                let partners = scene
                    .effect
                    .iter()
                    .filter(acts)
                    .flat_map(|e| e.between.iter().flatten());
                let partners: BTreeSet<&str> = partners.map(String::as_str).filter(|n| *n != name).collect();
                out.push(format!(
                    "model '{name}': makes {own_steps} own steps in a step of the run, not step.ratio = {asked}: an effect between it and \
                     '{}' has them step together, and another of them needs as many; name {own_steps}, or longer steps there",
                    partners.into_iter().collect::<Vec<_>>().join("', '")
                ));
            }
            OwnStep::Implicit => {
                let advices = advice::implicit(s.own_dt(), *critical);
                out.extend(advices.map(|a| format!("model '{name}': {a}")));
            }
            _ => {}
        }
    }
}

/// Warns if a run of few whole steps continues well beyond the requested end.
fn beyond_the_end(scene: &LoweredScene, built: &Built) -> Option<String> {
    let (end, begin, dt) = (scene.time.end?, built.run.time(), built.run.dt());
    let last = begin + built.steps as f64 * dt;
    let several = built.run.subdomains().iter().any(|s| s.own_steps() > 1);
    let limit = if several { OVERRUN } else { OVERRUN_ALONE };
    (last - end > limit * (end - begin)).then(|| {
        let (why, remedy) = match several {
            true => (", in which models make their own", "give models fewer own steps, or "),
            false => ("", ""),
        };
        format!(
            "time.end = {end:.3e} s: the run goes on to {last:.3e} s, since it is made of whole steps of {dt:.3e} s{why}; {remedy}\
             choose a shorter time.step.seconds"
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spec::RegionShape::{Ball, Box, Cylinder};

    /// The width of a shell is that of its thinnest place, where its surfaces have different centres or axes.
    #[test]
    fn the_thinnest_place_of_a_shell_is_its_width() {
        let shell = |core, domain| {
            width(&OverlapSource::Given(OverlapShape::Shell { core, domain })).expect("a width")
        };
        let ball = |x, radius| Ball {
            centre: [x, 0.0, 0.0],
            radius,
        };
        assert!((shell(ball(1.0, 2.0), ball(1.5, 4.0)) - 1.5).abs() < 1e-12);
        let bar = |x, z, radius| Cylinder {
            point: [x, 0.0, z],
            axis: [0.0, 0.0, 3.0],
            radius,
        };
        assert!((shell(bar(1.0, 0.0, 2.0), bar(0.5, 7.0, 4.0)) - 1.5).abs() < 1e-12);
        let cuboid = |low, high| Box {
            low: [low, 0.0, 0.0],
            high: [high, 1.0, 1.0],
        };
        assert!((shell(cuboid(2.0, 5.0), cuboid(1.0, 5.5)) - 0.5).abs() < 1e-12);
    }
}
