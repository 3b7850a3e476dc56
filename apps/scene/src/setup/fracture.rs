//! `fracture` of particles: criterion, strength or fracture energy, scatter. A scene lists it among its
//! effects; in the set-up it is an option of the particle model: bonds break without a force of their own.

use super::filling::beam;
use super::names::effect_models;
use super::packing::{PackingLine, Softening, Toughness};
use crate::error::{Result, dem, key, value};
use crate::setup::{LoweredModel, LoweredScene};
use crate::spec::{self, CriterionKind, Effect, EffectKind};
use arlequin::dem_beam::fracture::{SharedLog, diameter_of_both, tensile_strength};
use arlequin::dem_beam::{BeamMaterial, Criterion, DemModel, Fracture, Scatter};

/// Strength of the beams, or particles, over that of the body, without scatter, for beams of the radius ratio
/// [`MEASURED`] (docs/calibration.md).
const BEAMS_OVER_BODY: [(Criterion, f64); 4] = [
    (Criterion::Axial, 4.0),
    (Criterion::Rankine, 12.0),
    (Criterion::Mises, 12.0),
    (Criterion::Hydrostatic, 0.87),
];

/// Radius ratio of beams at which [`BEAMS_OVER_BODY`] was measured.
const MEASURED: f64 = 0.71;

/// Power of the radius ratio with which beams over body fall: 10 and 26 were measured for `axial` and
/// `rankine` at 0.5, and 25 and 70 at 0.34. Thin beams bend under a smaller share of the load.
const THINNER: f64 = -2.5;

/// Fracture of a model that is being built.
#[derive(Default)]
pub(super) struct Breaking {
    /// Log of broken bonds, if fracture is on.
    pub log: Option<SharedLog>,
    /// True if the scene has fracture for the model, enabled or not.
    pub brittle: bool,
}

/// Gives the bonds of a model their strengths, and its packing the toughness that follows.
///
/// # Errors
/// Those of [`fracture`], and of bonds that cannot have such strengths.
pub(super) fn apply(
    mut model: DemModel,
    (name, table): (&str, &LoweredModel),
    effects: &[(usize, &Effect)],
    packing: &mut PackingLine,
) -> Result<(DemModel, Breaking)> {
    let mut out = Breaking::default();
    for (k, e) in effects {
        let EffectKind::Fracture(f) = &e.kind else {
            continue;
        };
        out.brittle = true;
        let path = format!("effect[{k}].fracture");
        let diameter = 2.0 * model.body().mean_radius();
        let spec = fracture(&path, f, (name, table), Some(diameter))?;
        // With fracture off, the strengths only serve the warning that bonds would break.
        if !e.enabled {
            model = model.with_watched_strength(spec).map_err(dem(&path))?;
        } else {
            model = model.with_fracture(spec).map_err(dem(&path))?;
            out.log = Some(model.break_log());
        }
        packing.toughness = toughness(f, name, table, &model)?;
    }
    Ok((model, out))
}

/// Diameter \[m\] that no sphere is below: beams of every other one pass its check of softening.
const SMALLEST: f64 = 1e-12;

/// Checks the fracture that effect `k` gives to its models, as far as the size of the spheres does not enter.
pub(super) fn check(k: usize, e: &Effect, f: &spec::Fracture, scene: &LoweredScene) -> Result<()> {
    let (path, models) = (format!("effect[{k}].fracture"), effect_models(k, e, scene)?);
    if let (Some(_), Some(every @ 2..)) = (&scene.statics, f.every) {
        let rule = "is for time steps: at rest, bonds are checked in every step of a relaxation; remove it";
        return Err(value(format!("{path}.every"), every, rule));
    }
    let mut tables = scene.model.iter().enumerate().filter(|(m, _)| models.contains(m));
    tables.try_for_each(|(_, (name, table))| {
        fracture(&path, f, (&format!("model.{name}"), table), table.spacing).map(|_| ())
    })
}

/// Checks the fracture of one model before its spheres are made; `diameter` is the wanted mean \[m\].
///
/// # Errors
/// Those of [`fracture`].
pub(super) fn check_size(
    (name, table): (&str, &LoweredModel),
    effects: &[(usize, &Effect)],
    diameter: Option<f64>,
) -> Result<()> {
    effects.iter().try_for_each(|(k, e)| match &e.kind {
        EffectKind::Fracture(f) => {
            fracture(&format!("effect[{k}].fracture"), f, (name, table), diameter).map(|_| ())
        }
        _ => Ok(()),
    })
}

/// Returns whether the scene ends the run when a crack of model `m` runs into an overlap.
pub(crate) fn stops_at_overlap(scene: &LoweredScene, m: usize) -> bool {
    let stopping = |(k, e): (usize, &Effect)| {
        let stops = e.enabled && matches!(&e.kind, EffectKind::Fracture(f) if f.stop_at_overlap);
        stops && effect_models(k, e, scene).is_ok_and(|models| models.contains(&m))
    };
    scene.effect.iter().enumerate().any(stopping)
}

/// Returns when the bonds of a model break. `diameter` is the mean of its spheres \[m\], if it is known.
///
/// # Errors
/// Keys that are missing or exclude each other; values out of range.
pub(crate) fn fracture(
    path: &str,
    f: &spec::Fracture,
    (name, model): (&str, &LoweredModel),
    diameter: Option<f64>,
) -> Result<Fracture> {
    let scatter = match (f.weibull, f.deviation) {
        (Some(_), Some(_)) => return Err(key(path, "weibull and deviation exclude each other; remove one")),
        (Some(modulus), None) => Scatter::Weibull { modulus },
        (None, Some(deviation)) => Scatter::Normal { deviation },
        (None, None) => Scatter::None,
    };
    let beam = beam(name, model)?;
    let ratio = beam.radius_ratio;
    let young = body_young(model, &beam, model.known_material(name)?.young);
    let base = match (f.gc, f.strength) {
        (Some(gc), Some(strength)) if f.softening => {
            if f.criterion.is_some() {
                let rule = "beams that soften have a criterion of their own, the energy of tensile-energy; remove it";
                return Err(key(format!("{path}.criterion"), rule));
            }
            Fracture::softening(gc, strength, &beam, diameter.unwrap_or(SMALLEST)).map_err(dem(path))?
        }
        _ if f.softening => {
            let rule = "softening needs gc, the fracture energy of the body [J/m2], and strength, the axial stress [Pa] from which on \
                        beams soften";
            return Err(key(path, rule));
        }
        (Some(gc), Some(strength)) => {
            // Otherwise the message below would tell what impossible values imply.
            let given = [("gc", gc), ("strength", strength)];
            if let Some((name, x)) = given.into_iter().find(|(_, x)| !(*x > 0.0 && x.is_finite())) {
                let rule = format!("is {x:e}, must be finite and above zero");
                return Err(key(format!("{path}.{name}"), rule));
            }
            return Err(key(
                path,
                contradiction(f, [gc, strength, ratio], (young, model.spacing)),
            ));
        }
        (Some(gc), None) => Fracture::from_fracture_energy(criterion(f), gc, ratio).map_err(dem(path))?,
        // No criterion by default: the unit of a strength depends on it.
        (None, Some(strength)) if f.criterion.is_some() => Fracture::new(criterion(f), strength),
        (None, Some(_)) => {
            let rule = "strength needs criterion: a stress [Pa] for axial, rankine, mises and hydrostatic, an energy per section [J/m2] \
                        for energy and tensile-energy";
            return Err(key(path, rule));
        }
        (None, None) => {
            let rule = "needs gc, the fracture energy of the body [J/m2], or strength with criterion";
            return Err(key(path, rule));
        }
    };
    let spec = Fracture {
        scatter,
        seed: f.seed,
        every: f.every.unwrap_or(1),
        spare_overlap: f.spare_overlap,
        ..base
    };
    spec.check().map_err(dem(path))?;
    Ok(spec)
}

/// Returns the criterion, by default that of a fracture energy.
fn criterion(f: &spec::Fracture) -> Criterion {
    match f.criterion {
        Some(CriterionKind::Axial) => Criterion::Axial,
        Some(CriterionKind::Rankine) => Criterion::Rankine,
        Some(CriterionKind::Mises) => Criterion::Mises,
        Some(CriterionKind::Energy) => Criterion::Energy,
        Some(CriterionKind::TensileEnergy) | None => Criterion::TensileEnergy,
        Some(CriterionKind::Hydrostatic) => Criterion::Hydrostatic,
    }
}

/// Describes what a fracture energy and a strength each imply, and when both hold.
fn contradiction(
    f: &spec::Fracture,
    [gc, strength, ratio]: [f64; 3],
    (young, diameter): (f64, Option<f64>),
) -> String {
    let criterion = criterion(f);
    let both = format!("gc = {gc:e} J/m2 and strength = {strength:e} exclude each other");
    // Under a criterion of energies both keys give the same quantity, so that each implies the other.
    if let (Some(_), Some(share)) = (f.criterion, criterion.released_share(ratio)) {
        return format!(
            "{both}: gc implies a strength of {:.3e} J/m2, and the strength a gc of {:.3e} J/m2; remove one",
            gc / share,
            share * strength
        );
    }
    // Only a scene with a spacing says the diameter at this point.
    let implied = diameter.map_or(String::new(), |d| {
        let body = tensile_strength(young, gc, d);
        format!("gc gives a body of spheres of {d:.3e} m a strength in tension of {body:.2e} Pa; ")
    });
    // Only stress criteria have a ratio that was measured; for the others the strength stands for that of the
    // body.
    let share = BEAMS_OVER_BODY.iter().find(|(c, _)| *c == criterion);
    let (of_beams, body) = share.map_or((String::new(), strength), |(c, share)| {
        let name = c.name();
        let (what, share) = match c.is_of_particles() {
            true => ("particles", *share),
            false => ("beams", share * (ratio / MEASURED).powf(THINNER)),
        };
        let body = strength / share;
        let text = format!("the strength of {what} by '{name}' means about {body:.2e} Pa; ");
        (text, body)
    });
    format!(
        "{both}: {implied}{of_beams}the body has the toughness of gc and a strength of {body:.2e} Pa with spheres of \
         {:.2e} m only; keep gc without a criterion of stresses, remove gc, or let beams soften from an axial stress on \
         (softening = true, without a criterion)",
        diameter_of_both(young, gc, body)
    )
}

/// Young's modulus of the body \[Pa\]: that of its material, or what beams make of it that the scene gives.
fn body_young(model: &LoweredModel, beam: &BeamMaterial, young: f64) -> f64 {
    model.dem.young.map_or(young, |_| beam.bulk()[0])
}

/// Returns what a fracture energy implies for a model of particles, if one is given.
fn toughness(
    f: &spec::Fracture,
    name: &str,
    table: &LoweredModel,
    model: &DemModel,
) -> Result<Option<Toughness>> {
    let Some(gc) = f.gc else { return Ok(None) };
    let (beam, diameter) = (beam(name, table)?, 2.0 * model.body().mean_radius());
    let young = body_young(table, &beam, table.known_material(name)?.young);
    let softens = f.strength.filter(|_| f.softening);
    let softening = softens.map(|peak| {
        Ok(Softening {
            peak,
            largest: Fracture::largest_diameter(gc, peak, &beam)?,
            snapping: model.snapping_bonds(),
        })
    });
    Ok(Some(Toughness {
        gc,
        diameter,
        tensile_strength: f
            .strength
            .is_none()
            .then(|| tensile_strength(young, gc, diameter)),
        softening: softening.transpose().map_err(dem(name))?,
    }))
}
