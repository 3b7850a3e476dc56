//! The acceptance checks of the method on the line: bar and chain of `arlequin_studies`.

use super::row::{Accept, Row};
use super::{Done, Figure, Report, Series, at};
use crate::line::{Line, rest, run};
use crate::waves::{self, Damping};
use arlequin::core::weight::Profile;
use arlequin::core::{Error as Core, TimeStep};
use arlequin_scene::Result;

/// Numbers of a program of its own, written before this one from the same equations.
const PROTOTYPE: &str = "this method, independent prototype";
/// One material throughout: nothing to reflect.
const HOMOGENEOUS: &str = "a homogeneous line";

fn rows(rows: Vec<Row>) -> Result<Report> {
    Ok(Report {
        rows,
        figures: Vec::new(),
    })
}

/// Checks 1 and 2.
pub(super) fn transmission(_: &Done) -> Result<Report> {
    let mut out = Vec::new();
    for alpha in [0.3, 0.5, 0.8] {
        let line = Line {
            profile: Profile::Constant(alpha),
            ..Line::default()
        };
        let p = waves::long_pulse(&line).map_err(at("transmission"))?;
        let name = |what: &str| format!("{what}, alpha = {alpha} in the overlap");
        out.push(Row::against(
            name("t"),
            p.t,
            1.0,
            HOMOGENEOUS,
            Accept::Absolute(0.005),
        ));
        out.push(Row::against(
            name("r"),
            p.r,
            0.0,
            HOMOGENEOUS,
            Accept::Absolute(0.02),
        ));
        out.push(Row::new(name("drift of H"), p.drift, Accept::AtMost(1e-10)));
    }
    for (alpha, expected) in [(0.3, 1.386), (0.5, 0.9885), (0.8, 0.397)] {
        let line = Line {
            everywhere: Some(alpha),
            ..Line::default()
        };
        let p = waves::long_pulse(&line).map_err(at("transmission"))?;
        let name = format!("t, alpha = {alpha} everywhere");
        out.push(
            Row::against(name, p.t, expected, PROTOTYPE, Accept::Absolute(0.005))
                .note("weights over the whole subdomains are an impedance jump, meant here"),
        );
    }
    rows(out)
}

/// Check 3.
pub(super) fn invariants(_: &Done) -> Result<Report> {
    let line = Line {
        coarse_elements: 20,
        fine_bonds: 120,
        overlap: 40.0,
        ..Line::default()
    };
    let mut c = waves::random_state(&line, [2, 1]).map_err(at("invariants"))?;
    run(&mut c, 20_000).map_err(at("invariants"))?;
    let [_, displacement] = c.jumps(0);
    rows(vec![
        Row::new(
            "drift of H, random state, 20 000 steps",
            c.drift(),
            Accept::AtMost(1e-9),
        ),
        Row::new(
            "velocity constraint",
            c.constraint_residual(),
            Accept::AtMost(1e-12),
        ),
        Row::new("displacement constraint", displacement, Accept::AtMost(1e-10)),
    ])
}

/// Check 4.
pub(super) fn critical_step(_: &Done) -> Result<Report> {
    let mut out = Vec::new();
    for epsilon in [0.05, 0.005, 0.0005] {
        let line = Line {
            epsilon,
            coarse_elements: 30,
            fine_bonds: 200,
            ..Line::default()
        };
        let c = line.build(&rest, &rest).map_err(at("critical step"))?;
        let ratio = c.critical_steps().iter().fold(f64::MAX, |a, b| a.min(*b));
        let name = format!("critical step over that of the fine model, epsilon = {epsilon}");
        out.push(Row::against(
            name,
            ratio,
            1.0,
            "free chain, 2/omega_max",
            Accept::Between(1.0 - 1e-6, 1.0005),
        ));
        let at_factor = |factor: f64| {
            let step = TimeStep::Unchecked(ratio * factor);
            let mut c = waves::random_state(&Line { step, ..line.clone() }, [7, 3])?;
            run(&mut c, 20_000)?;
            Ok(c.drift())
        };
        let below = at_factor(0.999).map_err(at("critical step"))?;
        let name = format!("drift of H at 0.999 of it, epsilon = {epsilon}");
        out.push(Row::new(name, below, Accept::AtMost(1e-6)));
        let blown = match at_factor(1.001) {
            Err(Core::EnergyGrowth { .. } | Core::Diverged { .. }) => 1.0,
            Err(e) => return Err(at("critical step")(e)),
            Ok(_) => 0.0,
        };
        let name = format!("stopped as unstable at 1.001 of it (1 = yes), epsilon = {epsilon}");
        out.push(Row::new(name, blown, Accept::AtLeast(1.0)));
    }
    rows(out)
}

/// Check 5, and the absorber over wavelengths.
pub(super) fn absorber(done: &Done) -> Result<Report> {
    let line = waves::packet_line();
    let send = |wavelength: f64, width: f64, damping: Option<Damping>| {
        waves::packet(&line, wavelength, width, damping).map_err(at("absorber"))
    };
    let bare = send(8.0, 60.0, None)?;
    let damped = send(8.0, 60.0, Some(Damping::STANDARD))?;
    let long = send(f64::INFINITY, 100.0, Some(Damping::STANDARD))?;
    let out = vec![
        Row::against(
            "energy reflected, wavelength 8 r, no absorber",
            bare.back,
            1.0,
            "conservation",
            Accept::Absolute(0.003),
        )
        .note("the papers say that the projection dampens high frequencies; the scheme conserves them all"),
        Row::new("the same with absorber", damped.back, Accept::AtMost(0.003)),
        Row::new(
            "energy lost by a long pulse",
            1.0 - long.kept,
            Accept::AtMost(2e-4),
        ),
        Row::new(
            "ledger of all three, drift of H",
            bare.drift.max(damped.drift).max(long.drift),
            Accept::AtMost(1e-9),
        ),
    ];
    let count = if done.quick { 6 } else { 14 };
    let waves = waves::wavelengths(4.0, 100.0, count);
    let mut curves = Vec::new();
    let finer = Damping {
        resolved: Some(20.0),
        ..Damping::STANDARD
    };
    for (name, damping) in [
        ("no absorber", None),
        ("absorber, mediator kept", Some(Damping::STANDARD)),
        ("absorber, 2 h_B kept", Some(finer)),
    ] {
        let mut back = Vec::new();
        for w in &waves {
            back.push(send(*w, 60.0f64.max(1.5 * w), damping)?.back.max(1e-6));
        }
        curves.push((name.to_owned(), waves.clone(), back));
    }
    let figure = absorber_figure(curves);
    Ok(Report {
        rows: out,
        figures: vec![figure],
    })
}

fn absorber_figure(curves: Vec<Series>) -> Figure {
    Figure {
        file: "absorber",
        title: "Energy that comes back from the overlap",
        axes: [["wavelength over particle spacing", ""], ["energy reflected over incident", ""]],
        log: [true, true],
        curves,
        says: "The papers say that the projection dampens what the coarse model cannot carry. We see that without an \
               absorber all of it comes back (wavelengths below about 31 r, the coarse cutoff), because the constrained \
               scheme conserves energy exactly; with the absorber it leaves through a line of the ledger. A coarser \
               space that stays undamped closes the gap just above the cutoff."
            .into(),
    }
}

/// Check 6.
pub(super) fn patch(_: &Done) -> Result<Report> {
    let stations: Vec<f64> = (0..=4).map(|k| f64::from(k) / 4.0).collect();
    let compatible = Profile::mediator_compatible(&stations).map_err(at("patch"))?;
    let mut out = Vec::new();
    for (name, profile, accept) in [
        ("linear weight", Profile::Linear, Accept::AtMost(1e-11)),
        ("mediator-compatible C1 weight", compatible, Accept::AtMost(1e-11)),
        ("plain cubic weight", Profile::Cubic, Accept::Between(1e-6, 5e-3)),
    ] {
        let line = Line {
            profile,
            ..waves::patch_line()
        };
        let defect = waves::patch_defects(&line).map_err(at("patch"))?;
        // The strain jumps from spring to spring where the displacement does not: it is off by a fifth, at the border
        // where the weight of the springs vanishes.
        let strain = match accept {
            Accept::AtMost(_) => Accept::AtMost(1e-10),
            _ => Accept::Between(1e-2, 0.25),
        };
        for (what, value, accept) in [
            ("displacement", defect.displacement, accept),
            ("strain", defect.strain, strain),
        ] {
            let row = Row::new(format!("defect of uniform strain, {what}, {name}"), value, accept);
            out.push(match accept {
                Accept::AtMost(_) => row,
                _ => row
                    .note("its gradient is not in the mediator space: small in displacement, not in strain"),
            });
        }
    }
    rows(out)
}

/// Check 7, and reflection and transmission against frequency.
pub(super) fn reflection(_: &Done) -> Result<Report> {
    let mut out = Vec::new();
    let mut curves = Vec::new();
    let dense = waves::wavelengths(3.2, 40.0, 200);
    for (overlap, sampled, all, strained) in [
        (20.0, 0.0845, 0.0847, 2.77),
        (40.0, 0.0239, 0.0266, 2.11),
        (80.0, 0.0070, 0.0071, 1.888),
    ] {
        let line = Line {
            profile: Profile::Cubic,
            epsilon: 1e-6,
            overlap,
            ..Line::default()
        };
        let six = waves::top_reflection(&line, &[4.2, 6.0, 8.0, 12.0, 20.0, 40.0]);
        let six = six.map_err(at("reflection"))?;
        let name = format!("largest |r| of six wavelengths, L_O = {} h", overlap / 10.0);
        out.push(Row::against(
            name,
            six,
            sampled,
            PROTOTYPE,
            Accept::Relative(0.05),
        ));
        let every = waves::top_reflection(&line, &waves::wavelengths(4.2, 40.0, 200));
        let name = format!("largest |r| over [4.2, 40] h, L_O = {} h", overlap / 10.0);
        let every = every.map_err(at("reflection"))?;
        out.push(Row::against(
            name,
            every,
            all,
            "ours, version 0.1: a regression",
            Accept::Relative(0.05),
        ));
        let long = waves::scattering(&line, &[12.0]).map_err(at("reflection"))?;
        let name = format!(
            "largest strain over the incident one at 12 h, L_O = {} h",
            overlap / 10.0
        );
        out.push(
            Row::against(
                name,
                long[0].strain[1],
                strained,
                "ours, version 0.1: a regression",
                Accept::Relative(0.02),
            )
            .note("the weight of the fine model vanishes at its border, where its springs are strained too much"),
        );
        let found = waves::scattering(&line, &dense).map_err(at("reflection"))?;
        // Frequency over that of the coarse cutoff c/(π h).
        let f: Vec<f64> = found
            .iter()
            .map(|s| (std::f64::consts::PI / s.wavelength).sin() * line.h)
            .collect();
        let r = found.iter().map(|s| s.reflection.max(1e-6)).collect();
        curves.push((format!("r, L_O = {} h", overlap / 10.0), f.clone(), r));
        if overlap < 30.0 {
            let t = found.iter().map(|s| s.transmission.max(1e-6)).collect();
            curves.push(("t, L_O = 2 h".to_owned(), f, t));
        }
    }
    let figure = Figure {
        file: "reflection",
        title: "Reflection and transmission against frequency (C1 weight, h_B = h)",
        axes: [["frequency over the coarse cutoff", ""], ["amplitude over incident", ""]],
        log: [false, true],
        curves,
        says: "The papers find that results improve as the overlap widens. We see the same and why: the largest reflected \
               amplitude up to three quarters of the cutoff falls with about the square of the width, from 8 % to 0.7 %; at \
               the cutoff it rises steeply for every width, and beyond it all comes back. The transmitted amplitude exceeds \
               one there because the coarse lattice carries the same power with a larger motion."
            .into(),
    };
    Ok(Report {
        rows: out,
        figures: vec![figure],
    })
}

/// Check 8.
pub(super) fn rank(_: &Done) -> Result<Report> {
    let line = Line {
        mediator: 0.5,
        fine_bonds: 600,
        coarse_elements: 60,
        ..Line::default()
    };
    let pulse = crate::line::pulse(150.0, 100.0, 0.0, -1.0);
    let mut c = line.build(&rest, &pulse).map_err(at("rank"))?;
    let report = c.interfaces()[0].report().clone();
    run(&mut c, 1000).map_err(at("rank"))?;
    rows(vec![
        Row::against(
            "independent of 41 multipliers in an overlap of 21 particles",
            report.rank as f64,
            21.0,
            "functions of the chain in the overlap, counted",
            Accept::Absolute(0.0),
        ),
        Row::new(
            "warnings given",
            report.warnings.len() as f64,
            Accept::AtLeast(2.0),
        ),
        Row::new("drift of H afterwards", c.drift(), Accept::AtMost(1e-10)),
    ])
}
