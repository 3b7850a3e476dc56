//! Beam A: tension of the small beam.

use super::beams::{Deck, Record, RunSpec, Theory};
use super::check::{Accept, Check};
use super::{Figure, Report, Runs};
use arlequin_scene::Result;

const BAR: Theory = Theory {
    length: 0.02,
    radius: 0.001,
};
const J13: &str = "Jebahi et al. 2013, table 2";
const SOLID: &str = "converged solid, 27-node hexahedra";
/// Elongation \[m\] and axial frequencies \[Hz\] of the converged solid.
const TRUTH: [f64; 4] = [0.08775e-3, 71_815.0, 215_369.0, 358_690.0];
/// Printed values for DEM alone and CNEM alone.
const PRINTED: [(&str, [f64; 4]); 2] = [
    ("dem", [0.083e-3, 72_408.0, 217_246.0, 362_072.0]),
    ("cnem", [0.088e-3, 71_359.0, 214_023.0, 356_491.0]),
];
/// Names of these four values.
const NAMES: [&str; 4] = ["U_mean [m]", "f0 [Hz]", "f1 [Hz]", "f2 [Hz]"];

/// Returns the assignments of an overlap of the given width around the middle.
fn overlap(width: f64) -> Vec<String> {
    let (low, high) = (10e-3 - 0.5 * width, 10e-3 + 0.5 * width);
    vec![
        format!("model.left.shape.cylinder.length={high}"),
        format!("model.right.shape.cylinder.from=[{low},0.0,0.0]"),
        format!("model.right.shape.cylinder.length={}", 20e-3 - low),
        format!("interface.middle.overlap.slab.coarse=[{low},0.0,0.0]"),
        format!("interface.middle.overlap.slab.fine=[{high},0.0,0.0]"),
    ]
}

/// Assignments of a packet of short waves that starts in the particles.
const PACKET: [&str; 3] = [
    "load=[]",
    "initial=[{ models = [\"right\"], wave = { component = \"x\", along = \"x\", centre = 14.5e-3, width = 0.5e-3, amplitude = 1e-7, speed = -5740.6 } }]",
    "time={ end = 20e-6 }",
];
const ABSORBER: &str = "interface.middle.absorber={ rate_factor = 0.2 }";

/// Returns the runs of beam A.
pub(super) fn runs(quick: bool) -> Vec<RunSpec> {
    let fem = ["model.whole.kind=fem", "model.whole.spacing=0.47e-3"];
    let cnem = ["model.whole.kind=cnem", "model.whole.spacing=0.47e-3"];
    let mut out = vec![
        RunSpec::new("a/fem", Deck::AAlone, 1, &fem),
        RunSpec::new("a/cnem", Deck::AAlone, 2, &cnem),
    ];
    if quick {
        return out;
    }
    let coupled = |key: &str, set: &[&str]| RunSpec::new(key, Deck::A, 40, set);
    let constant = "interface.middle.weight={ profile = \"constant\", value = 0.5 }";
    let free = [
        "support=[]",
        "load=[]",
        "initial=[{ velocity.polynomial = { component = \"y\", along = \"x\", coefficients = [1.0, 100.0] } }]",
        "time={ steps = 400 }",
    ];
    let packet: Vec<String> = PACKET.iter().map(|s| (*s).to_owned()).collect();
    out.extend([
        RunSpec::new("a/dem", Deck::AAlone, 50, &[]),
        coupled("a/cnem-dem", &[]),
        coupled("a/fem-dem", &["model.left.kind=fem"]),
        coupled("a/cnem-dem wide", &[]).with(&overlap(6e-3)),
        coupled(
            "a/cnem-dem constant",
            &[constant, "interface.middle.junction={ kind = \"l2\" }"],
        ),
        coupled("a/cnem-dem free", &free),
        coupled("a/cnem-dem packet", &["model.left.kind=fem"])
            .with(&overlap(4e-3))
            .with(&packet),
        coupled("a/cnem-dem packet absorbed", &["model.left.kind=fem", ABSORBER])
            .with(&overlap(4e-3))
            .with(&packet),
    ]);
    out
}

/// Returns elongation and three frequencies of a run.
fn measured(r: &Record) -> [f64; 4] {
    let f = |k: u32| r.frequency("free-end", BAR.axial(k));
    [r.mean("free-end"), f(0), f(1), f(2)]
}

/// Compares one run with theory, solid and printed values.
fn rows_of(kind: &str, r: &Record, most: [f64; 4]) -> Vec<Check> {
    let ours = measured(r);
    let theory = [BAR.elongation(), BAR.axial(0), BAR.axial(1), BAR.axial(2)];
    let mut checks = Vec::new();
    for k in 0..4 {
        let name = format!("{kind}: {}", NAMES[k]);
        let accept = Accept::Relative(most[k]);
        checks.push(Check::against(
            name.clone(),
            ours[k],
            theory[k],
            "beam theory",
            accept,
        ));
        checks.push(Check::against(name.clone(), ours[k], TRUTH[k], SOLID, accept));
        if let Some((_, printed)) = PRINTED.iter().find(|p| p.0 == kind) {
            checks.push(Check::against(
                name,
                ours[k],
                printed[k],
                J13,
                // Printed values have errors of their own: five per cent at least.
                Accept::Relative(most[k].max(0.05)),
            ));
        }
    }
    checks.extend(r.health(kind));
    checks
}

/// Compares the energy of a short packet with and without absorber.
fn packet_rows(done: &Runs) -> Vec<Check> {
    let mut checks = Vec::new();
    // Both models together: what has left the particles may still be in the continuum.
    let energy_kept = |key: &str| done.get(key).map(|r| r.energies.iter().sum::<f64>());
    if let (Some(bare), Some(absorbed)) = (
        energy_kept("a/cnem-dem packet"),
        energy_kept("a/cnem-dem packet absorbed"),
    ) {
        checks.push(Check::against(
            "short packet in the particles: energy kept over 20 us, no absorber",
            bare,
            1.0,
            "conservation",
            Accept::Absolute(0.01),
        ));
        checks.push(
            Check::new("the same with absorber", absorbed, Accept::AtMost(0.9))
                .note("a packing scatters short waves: they come to the overlap, and leave, bit by bit"),
        );
        let drift = |key: &str| done.get(key).map_or(f64::NAN, |r| r.drift);
        checks.push(Check::new(
            "the same: drift of H, ledger closed",
            drift("a/cnem-dem packet absorbed"),
            Accept::AtMost(1e-9),
        ));
    }
    checks
}

/// Evaluates beam A.
pub(super) fn evaluate(done: &Runs) -> Result<Report> {
    let mut checks = Vec::new();
    // The mean modulus of a packing is 2.5 % above the printed one, without any fit. Coarse meshes err in
    // the third frequency.
    for (kind, most) in [
        ("fem", [0.01, 0.01, 0.015, 0.03]),
        ("cnem", [0.01, 0.01, 0.015, 0.03]),
        ("dem", [0.04, 0.025, 0.025, 0.03]),
    ] {
        if let Some(r) = done.get(&format!("a/{kind}")) {
            checks.extend(rows_of(kind, r, most));
        }
    }
    for kind in ["cnem-dem", "fem-dem", "cnem-dem wide", "cnem-dem constant"] {
        if let Some(r) = done.get(&format!("a/{kind}")) {
            checks.extend(rows_of(kind, r, [0.03, 0.02, 0.02, 0.03]));
        }
    }
    if let Some(r) = done.get("a/cnem-dem constant") {
        let u = r.mean("free-end");
        let row = Check::against(
            "cnem-dem constant: U_mean [m]",
            u,
            0.081e-3,
            "Jebahi et al. 2013, 3.2.1",
            Accept::Relative(0.1),
        );
        checks.push(row.note("theirs is 7 % below theory, ours is not: the nodal law is not conservative"));
    }
    if let Some(r) = done.get("a/cnem-dem free") {
        checks.push(Check::new(
            "free beam, 400 steps: momenta",
            r.momentum,
            Accept::AtMost(1e-12),
        ));
    }
    checks.extend(packet_rows(done));
    Ok(Report {
        checks,
        figures: figures(done),
    })
}

fn figures(done: &Runs) -> Vec<Figure> {
    let mut out = Vec::new();
    let curves = |list: &[(&str, &str)], probe: &str| -> Vec<_> {
        let series = list
            .iter()
            .filter_map(|(name, key)| Some(done.get(key)?.curve(name, probe)));
        series
            .map(|(n, t, v)| {
                // About three periods.
                let end = t.partition_point(|t| *t < 45e-6);
                (n, t[..end].to_vec(), v[..end].to_vec())
            })
            .collect()
    };
    let free = curves(
        &[
            ("DEM alone", "a/dem"),
            ("CNEM alone", "a/cnem"),
            ("CNEM | DEM, L_O = 2 mm", "a/cnem-dem"),
            ("CNEM | DEM, L_O = 6 mm", "a/cnem-dem wide"),
            ("constant weight, L2", "a/cnem-dem constant"),
        ],
        "free-end",
    );
    if free.len() > 2 {
        out.push(Figure {
            file: "beam-a-free-end",
            title: "Beam A: displacement of the pulled end",
            axes: [["time", "s"], ["displacement", "m"]],
            log: [false; 2],
            curves: free,
            says: "The papers show deviations of the coupled curve where the wave crosses the overlap, which shrink as the \
                   overlap widens, and a mean 7 % too small with constant weights. Ours lie between the curves of the two \
                   models alone for every weight and width; what separates those two is the modulus of the packing, some \
                   per cent above that of the continuum."
                .into(),
        });
    }
    out.extend(done.get("a/cnem-dem").map(check_points));
    out
}

fn check_points(r: &Record) -> Figure {
    let points = [
        ("coarse part", "coarse-part"),
        ("overlap, CNEM", "overlap-coarse"),
        ("overlap, DEM", "overlap-fine"),
        ("fine part", "fine-part"),
    ];
    // About one period.
    let cut = r.times.partition_point(|t| *t < 14e-6);
    Figure {
            file: "beam-a-check-points",
            title: "Beam A: velocity at the check points, CNEM | DEM, coarse mediator",
            axes: [["time", "s"], ["velocity", "m/s"]],
            log: [false; 2],
            curves: points
                .iter()
                .map(|(name, probe)| {
                    (
                        (*name).to_owned(),
                        r.times[..cut].to_vec(),
                        r.probe(probe).get(..cut).unwrap_or_default().to_vec(),
                    )
                })
                .collect(),
            says: "The papers find the two velocities in the overlap tied in the mean only by a coarse mediator. Here, with \
                   h_B = h_C and a width of four h_B, the two differ at the peaks of the short waves alone. Those do not \
                   die out: the scheme conserves them unless an absorber is asked for."
                .into(),
        }
}
