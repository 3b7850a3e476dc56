//! Beam B: tension, bending, torsion and initial velocity of the large beam.

use super::beams::{Deck, Record, RunSpec, Theory};
use super::check::{Accept, Check};
use super::{Figure, Report, Runs};
use arlequin_scene::Result;

const BAR: Theory = Theory {
    length: 0.1,
    radius: 0.01,
};
const J13: &str = "Jebahi et al. 2013, tables 5, 6";
const SOLID: &str = "converged solid, 27-node hexahedra";

/// A load with its probe, its duration and its reference values.
struct Load {
    name: &'static str,
    probe: &'static str,
    guess: fn(Theory) -> f64,
    periods: f64,
    /// Printed means and frequencies: theory, DEM, CNEM, coupled.
    printed: [[Option<f64>; 4]; 2],
    /// Mean and frequency of the converged solid.
    truth: [f64; 2],
    /// Mean and frequency by beam theory with shear.
    theory: fn(Theory) -> [f64; 2],
    /// Largest accepted errors of mean and frequency: the papers' own coupling error against theory.
    most: [f64; 2],
    units: [&'static str; 2],
}

const LOADS: [Load; 3] = [
    Load {
        name: "tension",
        probe: "pulled",
        guess: |b| b.axial(0),
        periods: 10.0,
        printed: [
            [Some(4.40e-6), Some(4.44e-6), Some(4.49e-6), Some(4.61e-6)],
            [Some(14_351.0), Some(14_235.0), Some(14_262.0), Some(14_425.0)],
        ],
        truth: [4.384e-6, 14_372.0],
        theory: |b| [b.elongation(), b.axial(0)],
        most: [0.048, 0.005],
        units: ["U_x [m]", "f0 [Hz]"],
    },
    Load {
        name: "bending",
        probe: "bent",
        guess: Theory::bending,
        periods: 4.0,
        printed: [
            [Some(5.85e-4), Some(5.86e-4), Some(6.27e-4), Some(6.13e-4)],
            [Some(1606.0), Some(1594.0), Some(1557.0), Some(1595.0)],
        ],
        truth: [5.950e-4, 1577.0],
        theory: |b| [b.deflection(), b.bending()],
        most: [0.048, 0.007],
        units: ["U_y [m]", "f0 [Hz]"],
    },
    Load {
        name: "torsion",
        probe: "twisted",
        guess: Theory::torsion,
        periods: 10.0,
        printed: [
            [Some(2.05e-3), Some(2.34e-3), None, Some(2.32e-3)],
            [Some(9382.0), Some(9252.0), None, Some(9106.0)],
        ],
        truth: [2.055e-3, 9381.8],
        theory: |b| [b.twist(), b.torsion()],
        // The papers' twist is 13 % off, which is no useful bound, so the bound of the other deflections is
        // taken.
        most: [0.048, 0.029],
        units: ["theta_x [rad]", "f0 [Hz]"],
    },
];

/// Returns the assignments of a load on a model, with the end of the run \[s\].
fn load(name: &str, model: &str, end: f64) -> Vec<String> {
    let mut set = vec![format!("time.end={end:e}")];
    match name {
        "bending" => set.push("load.0.force=[0.0,1000.0,0.0]".into()),
        "torsion" => set.push(format!(
            "load.0={{ name = \"twist\", model = \"{model}\", where = \"x-max\", torque = [10.0, 0.0, 0.0], time = \"step\" }}"
        )),
        "velocity" => {
            set.push("load=[]".into());
            let field = "{ component = \"x\", along = \"x\", coefficients = [0.0, 10.0] }";
            set.push(format!("initial=[{{ velocity.polynomial = {field} }}]"));
        }
        _ => {}
    }
    set
}

/// Spacings \[m\] of the continuum and of the spheres. 13 spheres across the bar limit the run time.
const MESH: &str = "2.0e-3";
const SPHERES: &str = "1.54e-3";

/// Returns the kinds of models, each with its scene, its assignments and its cost.
fn kinds(quick: bool) -> Vec<(&'static str, Deck, Vec<String>, u32)> {
    let assignments = |list: &[String]| list.to_vec();
    let alone = |kind: &str, h: &str| {
        assignments(&[
            format!("model.whole.kind={kind}"),
            format!("model.whole.spacing={h}"),
        ])
    };
    let mut out = vec![("fem", Deck::BAlone, alone("fem", MESH), 2)];
    if quick {
        return out;
    }
    let pair = |kind: &str| {
        assignments(&[
            format!("model.left.kind={kind}"),
            format!("model.left.spacing={MESH}"),
            format!("model.right.spacing={SPHERES}"),
        ])
    };
    out.extend([
        ("cnem", Deck::BAlone, alone("cnem", MESH), 5),
        ("dem", Deck::BAlone, alone("dem", SPHERES), 20),
        ("cnem-dem", Deck::B, pair("cnem"), 30),
        ("fem-dem", Deck::B, pair("fem"), 20),
    ]);
    out
}

/// Returns the runs of beam B.
pub(super) fn runs(quick: bool) -> Vec<RunSpec> {
    let mut out = Vec::new();
    for (kind, deck, set, cost) in kinds(quick) {
        let model = if matches!(deck, Deck::B) { "right" } else { "whole" };
        for l in &LOADS {
            if quick && l.name == "bending" {
                continue;
            }
            // As many periods as the spectrum needs for the frequency.
            let end = l.periods / (l.guess)(BAR);
            let dear = if l.name == "bending" { 5 } else { 1 };
            let spec = RunSpec::new(&format!("b/{kind} {}", l.name), deck, cost * dear, &[]);
            out.push(spec.with(&set).with(&load(l.name, model, end)));
        }
        if kind == "cnem-dem" {
            let end = format!("time.end={:e}", LOADS[0].periods / BAR.axial(0));
            let matched_modulus = ["model.left.material.young=75.8e9".to_owned(), end];
            out.push(
                RunSpec::new("b/cnem-dem matched", deck, cost, &[])
                    .with(&set)
                    .with(&matched_modulus),
            );
        }
        let spec = RunSpec::new(&format!("b/{kind} velocity"), deck, cost, &[]);
        out.push(spec.with(&set).with(&load("velocity", model, 3.0 / BAR.axial(0))));
    }
    out
}

/// Returns the accepted relative errors of mean and frequency of one model alone against the converged
/// solid.
fn band(kind: &str, load: &str) -> [f64; 2] {
    match (kind, load) {
        // The surface layer of a packed cylinder carries less, which makes it some per cent softer.
        ("dem", "tension") => [0.06, 0.04],
        ("dem", _) => [0.12, 0.06],
        // Torsion is slower because the outer nodes and their lumped mass lie on the rim.
        ("fem", "torsion") => [0.02, 0.02],
        ("fem", _) => [0.02, 0.01],
        // Integration over Voronoi cells converges from the soft side, and the lumped mass on the rim slows
        // torsion.
        ("cnem", "tension") => [0.01, 0.01],
        _ => [0.06, 0.07],
    }
}

fn measured(l: &Load, r: &Record) -> [f64; 2] {
    [r.mean(l.probe), r.frequency(l.probe, (l.guess)(BAR))]
}

fn alone_rows(kind: &str, l: &Load, r: &Record) -> Vec<Check> {
    // Column of the printed values.
    let column = if kind == "dem" { 1 } else { 2 };
    let mut checks = Vec::new();
    for (k, ours) in measured(l, r).into_iter().enumerate() {
        let name = format!("{kind}, {}: {}", l.name, l.units[k]);
        let most = band(kind, l.name)[k];
        checks.push(Check::against(
            name.clone(),
            ours,
            l.truth[k],
            SOLID,
            Accept::Relative(most),
        ));
        // Finite elements have no printed values.
        let printed = l.printed[k][column].filter(|_| kind != "fem");
        if let Some(p) = printed {
            checks.push(Check::against(
                name,
                ours,
                p,
                J13,
                Accept::Relative(most.max(0.08)),
            ));
        }
    }
    checks.extend(r.health(&format!("{kind}, {}", l.name)).into_iter().take(1));
    checks
}

fn coupled_rows(kind: &str, l: &Load, r: &Record, dem: Option<&Record>) -> Vec<Check> {
    let mut checks = Vec::new();
    let ours = measured(l, r);
    for k in 0..2 {
        let name = format!("{kind}, {}: {}", l.name, l.units[k]);
        let accept = Accept::Relative(l.most[k]);
        let theory = (l.theory)(BAR)[k];
        checks.push(
            Check::against(name.clone(), ours[k], theory, "beam theory, with shear", accept)
                .note("accepted: the papers' own coupling error"),
        );
        checks.push(Check::against(name.clone(), ours[k], l.truth[k], SOLID, accept));
        if l.name == "bending" {
            let thin = [BAR.thin_deflection(), BAR.thin_bending()][k];
            // What the thin theory leaves out is added, or a sound result would fail.
            let shear_effect = (l.truth[k] / thin - 1.0).abs();
            checks.push(
                Check::against(
                    name.clone(),
                    ours[k],
                    thin,
                    "beam theory as printed",
                    Accept::Relative(l.most[k] + shear_effect),
                )
                .note("without shear: off a solid by itself, which is added to what is accepted"),
            );
        }
        if let Some(d) = dem {
            checks.push(beside_dem(kind, l, k, ours[k], d));
        }
        if let Some(p) = l.printed[k][3] {
            checks.push(Check::against(name, ours[k], p, J13, Accept::Relative(0.15)));
        }
    }
    checks.extend(r.health(&format!("{kind}, {}", l.name)));
    checks
}

/// Compares a coupled value with that of our particles alone. The particles alone deviate from a solid,
/// mainly in their modulus, which a continuum part does not share. The deviation is added to the accepted
/// error where it shows: for finite elements and for the axial frequency.
fn beside_dem(kind: &str, l: &Load, k: usize, ours: f64, dem: &Record) -> Check {
    let alone = measured(l, dem)[k];
    let name = format!("{kind}, {}: {}", l.name, l.units[k]);
    let row = |most: f64| Check::against(name, ours, alone, "our DEM alone", Accept::Relative(most));
    if kind == "cnem-dem" && !(l.name == "tension" && k == 1) {
        return row(l.most[k]);
    }
    row(l.most[k] + (alone / l.truth[k] - 1.0).abs())
        .note("added: what the particles alone are off a solid; see the row of matched modulus")
}

/// Compares tension with a continuum of the packing's modulus, so that only the coupling error remains.
fn matched(done: &Runs) -> Vec<Check> {
    let l = &LOADS[0];
    let (Some(r), Some(d)) = (done.get("b/cnem-dem matched"), done.get("b/dem tension")) else {
        return Vec::new();
    };
    let (ours, alone) = (measured(l, r), measured(l, d));
    let row = |k: usize| {
        let name = format!(
            "cnem-dem, continuum of the packing's modulus, tension: {}",
            l.units[k]
        );
        Check::against(
            name,
            ours[k],
            alone[k],
            "our DEM alone",
            Accept::Relative(l.most[k]),
        )
    };
    vec![row(0), row(1)]
}

/// Evaluates beam B.
pub(super) fn evaluate(done: &Runs) -> Result<Report> {
    let mut checks = Vec::new();
    for l in &LOADS {
        for kind in ["fem", "cnem", "dem"] {
            if let Some(r) = done.get(&format!("b/{kind} {}", l.name)) {
                checks.extend(alone_rows(kind, l, r));
            }
        }
        let dem = done.get(&format!("b/dem {}", l.name));
        for kind in ["cnem-dem", "fem-dem"] {
            if let Some(r) = done.get(&format!("b/{kind} {}", l.name)) {
                checks.extend(coupled_rows(kind, l, r, dem));
            }
        }
    }
    checks.extend(matched(done));
    // An initial velocity V x/L stretches the bar to V L/2c by the time its wave has run along it once.
    let theory = 1.0 * BAR.length / (2.0 * 4.0 * BAR.length * BAR.axial(0));
    for kind in ["fem", "cnem", "dem", "cnem-dem", "fem-dem"] {
        let Some(r) = done.get(&format!("b/{kind} velocity")) else {
            continue;
        };
        let top = r.probe("pulled").iter().fold(0.0f64, |m, u| m.max(u.abs()));
        let name = format!("{kind}, initial velocity: largest U_x [m]");
        checks.push(Check::against(
            name,
            top,
            theory,
            "beam theory",
            Accept::Relative(0.05),
        ));
        checks.extend(r.health(&format!("{kind}, initial velocity")).into_iter().take(2));
    }
    Ok(Report {
        checks,
        figures: figures(done),
    })
}

/// Pictures: load, probe, file name, title, vertical axis.
const PICTURES: [(&str, &str, &str, &str, [&str; 2]); 4] = [
    (
        "tension",
        "pulled",
        "beam-b-tension",
        "Beam B: elongation under a sudden axial force",
        ["displacement", "m"],
    ),
    (
        "bending",
        "bent",
        "beam-b-bending",
        "Beam B: deflection under a sudden transverse force",
        ["displacement", "m"],
    ),
    (
        "torsion",
        "twisted",
        "beam-b-torsion",
        "Beam B: rotation under a sudden moment",
        ["rotation", "rad"],
    ),
    (
        "velocity",
        "pulled",
        "beam-b-velocity",
        "Beam B: elongation after an initial velocity",
        ["displacement", "m"],
    ),
];

fn figures(done: &Runs) -> Vec<Figure> {
    let mut out = Vec::new();
    for (load, probe, file, title, axis) in PICTURES {
        let kinds = [
            ("DEM alone", "dem"),
            ("CNEM alone", "cnem"),
            ("CNEM | DEM", "cnem-dem"),
            ("FEM | DEM", "fem-dem"),
        ];
        let curves: Vec<_> = kinds
            .iter()
            .filter_map(|(name, kind)| Some(done.get(&format!("b/{kind} {load}"))?.curve(name, probe)))
            .map(|(n, t, v)| {
                let end = t.last().copied().unwrap_or_default() * if load == "velocity" { 1.0 } else { 0.4 };
                let cut = t.partition_point(|t| *t <= end);
                (n, t[..cut].to_vec(), v[..cut].to_vec())
            })
            .collect();
        if curves.len() < 2 {
            continue;
        }
        out.push(Figure {
            file,
            title,
            axes: [["time", "s"], axis],
            log: [false; 2],
            curves,
            says: said(load).into(),
        });
    }
    out
}

fn said(load: &str) -> &'static str {
    match load {
        "tension" => {
            "The papers see no deviation left at 10 mm of overlap, and a mean 4.8 % above theory. Ours follow the curves of \
             the continuum; mean and frequency stay nearer to theory than theirs (table). The particles alone are faster, \
             as the modulus of a packing of 13 spheres across lies some per cent above that of the material."
        }
        "bending" => {
            "The papers are 4.8 % off in the mean; their theory leaves out shear, which a solid has: 1.8 % in the \
             frequency. Our means lie 2 to 3 % below a solid wherever the loaded end is made of particles, alone or coupled: \
             the load and the probe sit at the centres of the last layer, half a sphere inside the end, and the \
             deflection goes with the cube of the length. The frequencies do not know of it."
        }
        "torsion" => {
            "The papers' twist is 13 % above theory for DEM and coupling alike, their frequency 2.9 % below. Ours stay within \
             2 % for every model."
        }
        _ => {
            "The papers call the result comparable to the reference. Ours shows the arcs of parabolas of a bar with a linear \
             initial velocity; the coupled curves lie on that of the continuum, the particles alone are faster by their \
             modulus."
        }
    }
}
