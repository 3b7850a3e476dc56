//! The papers' parameter study on the line: weighting, junction length, mediator spacing, locking.

use super::check::{Accept, Check, short};
use super::{Figure, Report, Runs, Series, core_error};
use crate::line::{Line, Product, rest};
use crate::waves;
use arlequin::core::{Profile, Result as CoreResult, Weighting};
use arlequin_scene::Result;

const J13: &str = "Jebahi et al. 2013";
const J14: &str = "Jebahi et al. 2014";

/// Constant weights in the overlap: energy weighting is transparent, nodal weighting does not conserve
/// energy.
pub(super) fn weighting(_: &Runs) -> Result<Report> {
    let mut checks = Vec::new();
    for alpha in [0.3, 0.5, 0.8] {
        let (t, r) = (2.0 * (1.0 - alpha), 2.0 * alpha - 1.0);
        for weighting in [Weighting::Nodal, Weighting::Energy] {
            let line = Line {
                profile: Profile::Constant(alpha),
                weighting,
                ..Line::default()
            };
            let p = waves::long_pulse(&line).map_err(core_error("weighting"))?;
            let nodal = weighting == Weighting::Nodal;
            let name = |what: &str| {
                let law = if nodal { "nodal" } else { "energy" };
                format!("{what}, alpha = {alpha}, {law} weighting")
            };
            let note = if nodal {
                "the papers' law: their coefficients come from a change of the energy itself"
            } else {
                "ours: constant weights are transparent; the papers' coefficients are not expected"
            };
            let (accept_t, accept_r) = if nodal {
                (Accept::Absolute(0.06), Accept::Absolute(0.1))
            } else {
                (Accept::Between(0.995, 1.005), Accept::AtMost(0.02))
            };
            let source = "Jebahi et al. 2013, 2(1-alpha)";
            checks.push(Check::against(name("t"), p.t, t, source, accept_t).note(note));
            // The printed r has the sign of a force, which is opposite for a displacement.
            let r_row = Check::against(name("r"), -p.r, r, J13, accept_r);
            checks.push(if nodal {
                r_row.note("printed is 1 - t, not a measured reflection; here it is what comes back")
            } else {
                r_row
            });
            let what = name("relative change of energy");
            checks.push(if nodal {
                // Both models have the same impedance outside of the overlap.
                let expected = t * t + r * r - 1.0;
                let source = "t^2 + r^2 - 1 of their coefficients";
                Check::against(what, p.energy, expected, source, Accept::Absolute(0.05))
            } else {
                Check::new(what, p.energy, Accept::AtMost(1e-3))
            });
        }
    }
    Ok(checks.into())
}

/// Returns the condition number of the interface operator.
fn condition(line: &Line) -> CoreResult<f64> {
    Ok(line.build(&rest, &rest)?.interfaces()[0].report().condition)
}

/// Returns a short line with a continuous weight. Widths of overlap and mediator elements are in particle
/// spacings.
fn bench(profile: Profile<f64>, overlap: f64, mediator: f64, epsilon: f64, junction: Product) -> Line {
    Line {
        profile,
        overlap,
        mediator,
        epsilon,
        junction,
        // Short ends are enough: only the overlap is analysed.
        coarse_elements: overlap as usize / 10 + 10,
        fine_bonds: overlap as usize + 40,
        ..Line::default()
    }
}

/// Returns the tested junction lengths over the mediator's element length.
fn lengths() -> Vec<f64> {
    waves::wavelengths(0.01, 3.0, 60)
}

/// Returns the junction length with the smallest condition number, this number, and the condition numbers at
/// all tested lengths. Lengths are relative to the mediator's element length.
fn best_length(overlap: f64, mediator: f64) -> Result<((f64, f64), Vec<f64>)> {
    let mut best = (0.0, f64::INFINITY);
    let mut curve = Vec::new();
    for l in lengths() {
        let line = bench(
            Profile::Linear,
            overlap,
            mediator,
            0.005,
            Product::H1(l * mediator),
        );
        let c = condition(&line).map_err(core_error("conditioning"))?;
        curve.push(c);
        if c < best.1 {
            best = (l, c);
        }
    }
    Ok((best, curve))
}

/// Condition number over the junction length, best length by width and mediator, condition number over the
/// floor of the weight.
pub(super) fn conditioning(_: &Runs) -> Result<Report> {
    let mut checks = Vec::new();
    let mut curves = Vec::new();
    // Beam A has h_C = 0.47 mm and h_D = 0.1 mm: overlaps of 2, 4, 6 mm are 20, 40, 60 particles.
    for (overlap, published) in [(20.0, [230.0, 0.01]), (40.0, [230.0, 2.2]), (60.0, [238.0, 12.0])] {
        for (mediator, reference, published) in [(4.0, 320.0, published[0]), (1.0, 32.0, published[1])] {
            let (best, curve) = best_length(overlap, mediator)?;
            let (coarse, name) = if mediator > 1.0 {
                (true, "coarse")
            } else {
                (false, "fine")
            };
            if coarse {
                checks.push(
                    Check::against(
                        format!("l_opt / h_B, L_O = {} h_D, coarse mediator", short(overlap)),
                        best.0,
                        published / reference,
                        J14,
                        Accept::Between(0.2, 0.75),
                    )
                    .note("their meshes are not printed; the minimum must lie between a fifth and three quarters of h_B"),
                );
            }
            // On a flat curve the position of the minimum says little, so the condition at their length is
            // compared.
            let theirs = bench(
                Profile::Linear,
                overlap,
                mediator,
                0.005,
                Product::H1(published / reference * mediator),
            );
            let cost = condition(&theirs).map_err(core_error("conditioning"))? / best.1;
            let row = Check::new(
                format!(
                    "cond(their l) / cond(l_opt), L_O = {} h_D, {name} mediator",
                    short(overlap)
                ),
                cost,
                Accept::AtMost(4.0),
            );
            checks.push(row.note(format!(
                "theirs {} h_B, ours {} h_B",
                short(published / reference),
                short(best.0)
            )));
            let plain = condition(&bench(Profile::Linear, overlap, mediator, 0.005, Product::L2))
                .map_err(core_error("conditioning"))?;
            let name = format!(
                "cond(L2) / cond(H1 at l_opt), L_O = {} h_D, {name}",
                short(overlap)
            );
            let least = if coarse { 1.3 } else { 3.0 };
            checks.push(
                Check::new(name, plain / best.1, Accept::AtLeast(least)).note("what the best length gains"),
            );
            if overlap > 50.0 {
                let l = lengths();
                let growth = curve[curve.len() - 1] / best.1;
                let label = if coarse { "h_B = 4 h_D" } else { "h_B = h_D" };
                checks.push(
                    Check::new(
                        format!("cond(3 h_B) / cond(l_opt), {label}"),
                        growth,
                        Accept::AtLeast(10.0),
                    )
                    .note("past the minimum the condition grows as the fourth power of l"),
                );
                curves.push((label.to_owned(), l, curve));
            }
        }
    }
    epsilon_rows(&mut checks)?;
    let figure = condition_figure(curves);
    Ok(Report {
        checks,
        figures: vec![figure],
    })
}

fn condition_figure(curves: Vec<Series>) -> Figure {
    Figure {
        file: "conditioning",
        title: "Condition of the multiplier operator against the junction length (L_O = 60 h_D)",
        axes: [["l over h_B", ""], ["cond(A)", ""]],
        log: [true, true],
        curves,
        says: "The papers find that cond(A) falls to a minimum at a small l, about h_B, and grows steeply beyond it. We \
               see the minimum at 0.2 to 0.7 h_B with the coarse mediator and growth with the fourth power of l beyond: \
               the gradient term outweighs the mass term once l exceeds the shortest wave of the mediator."
            .into(),
    }
}

fn epsilon_rows(checks: &mut Vec<Check>) -> Result<()> {
    let published = [(0.05, 2.53e4), (0.005, 8.93e4), (0.0005, 5.67e5)];
    let mut first = [0.0; 2];
    for (epsilon, reference) in published {
        for (k, weighting) in [Weighting::Energy, Weighting::Nodal].into_iter().enumerate() {
            let line = Line {
                weighting,
                ..bench(Profile::Linear, 20.0, 1.0, epsilon, Product::L2)
            };
            // Nodal weighting shortens the critical step; here only the operator matters.
            let line = Line {
                step: arlequin::core::TimeStep::Fraction(0.5),
                ..line
            };
            let c = condition(&line).map_err(core_error("conditioning"))?;
            if first[k] <= 0.0 {
                // The first floor is the reference for the others.
                first[k] = c;
                continue;
            }
            let name = if k == 0 { "energy" } else { "nodal" };
            let row = Check::against(
                format!("cond(A) over that of epsilon = 0.05, epsilon = {epsilon}, {name} weighting"),
                c / first[k],
                reference / 2.53e4,
                J13,
                if k == 0 {
                    Accept::AtMost(3.0)
                } else {
                    // The condition grows as 1/epsilon, within 10 %.
                    Accept::Between(0.9 * 0.05 / epsilon, 1.1 * 0.05 / epsilon)
                },
            );
            checks.push(row.note(if k == 0 {
                "element means keep it flat, which is what we expect; theirs grows as nodal masses vanish"
            } else {
                "the smallest nodal mass goes with epsilon: the condition grows as 1/epsilon"
            }));
        }
    }
    Ok(())
}

/// Largest reflection below the cutoff over `h_B`, for the papers' three settings.
pub(super) fn mediator(_: &Runs) -> Result<Report> {
    let mut checks = Vec::new();
    let mut curves = Vec::new();
    let settings: [(f64, f64, f64, &[f64]); 3] = [
        (5.0, 20.0, 2.0, &[1.0, 2.0, 2.5, 4.0, 5.0, 10.0]),
        (
            10.0,
            20.0,
            3.0,
            &[1.0, 2.0, 2.5, 20.0 / 6.0, 4.0, 5.0, 10.0, 20.0],
        ),
        (
            10.0,
            60.0,
            9.0,
            &[1.0, 2.0, 3.0, 5.0, 6.0, 60.0 / 7.0, 10.0, 15.0, 20.0],
        ),
    ];
    for (h, overlap, published, tried) in settings {
        let mut reflections = Vec::new();
        for b in tried {
            let line = Line {
                h,
                ..bench(Profile::Cubic, overlap, *b, 1e-6, Product::L2)
            };
            let wavelengths = waves::wavelengths(4.2, 40.0, 100);
            reflections.push(waves::top_reflection(&line, &wavelengths).map_err(core_error("mediator"))?);
        }
        let best = (0..tried.len()).fold(0, |a, k| if reflections[k] < reflections[a] { k } else { a });
        let name = format!("h_C = {h} h_D, L_O = {overlap} h_D");
        let what = format!("best h_B / h_D, {name}");
        let row = Check::against(what, tried[best], published, J14, Accept::Relative(0.3));
        let upto = tried
            .iter()
            .zip(&reflections)
            .filter(|(b, _)| **b <= h)
            .map(|(_, r)| *r);
        let spread = upto.fold(0.0, f64::max) / reflections[best];
        if spread > 1.5 {
            checks.push(row.note(
                "ours: least reflection over 4.2 to 40 h_C; theirs is judged by eye on a free-end displacement",
            ));
        } else {
            let what = format!("largest over least reflection for h_B from h_D to h_C, {name}");
            checks.push(Check::new(what, spread, Accept::AtMost(1.5)).note(
                "all mediators reflect alike: the place of the least, which the papers name, says nothing",
            ));
        }
        let near = (0..tried.len()).fold(0, |a, k| {
            if (tried[k] - published).abs() < (tried[a] - published).abs() {
                k
            } else {
                a
            }
        });
        checks.push(
            Check::new(
                format!("reflection at their h_B over the least one, {name}"),
                reflections[near] / reflections[best],
                Accept::AtMost(2.0),
            )
            .note(format!(
                "and at h_B = h_D {} times the least one",
                short(reflections[0] / reflections[best])
            )),
        );
        curves.push((name, tried.to_vec(), reflections));
    }
    let figure = mediator_figure(curves);
    Ok(Report {
        checks,
        figures: vec![figure],
    })
}

fn mediator_figure(curves: Vec<Series>) -> Figure {
    Figure {
        file: "mediator",
        title: "Largest reflected amplitude below the cutoff against the mediator's length",
        axes: [["h_B over h_D", ""], ["largest reflected amplitude", ""]],
        log: [true, true],
        curves,
        says: "The papers find a best mediator between the two discretisations that grows with the overlap. We see the \
               same where the overlap is wide: there the best one is close to h_C, and one as fine as the particles \
               reflects several times as much, since it ties the particles to functions of the bar that end at the \
               border. In an overlap of two coarse elements the choice hardly matters."
            .into(),
    }
}

/// A steep pulse crosses the overlap: difference between the two velocity fields.
pub(super) fn locking(_: &Runs) -> Result<Report> {
    let mut checks = Vec::new();
    let mut curves = Vec::new();
    for (name, mediator, accept) in [
        ("fine", 1.0, Accept::AtMost(1e-6)),
        ("coarse", 10.0, Accept::Between(0.02, 1.0)),
    ] {
        let line = Line {
            coarse_elements: 60,
            fine_bonds: 300,
            ..bench(Profile::Cubic, 40.0, mediator, 0.05, Product::L2)
        };
        let tie = waves::tie(&line, 12.0).map_err(core_error("locking"))?;
        let row = Check::new(
            format!("difference of the overlap velocities, {name} mediator"),
            tie.difference,
            accept,
        );
        checks.push(row.note(format!(
            "the papers: a fine mediator locks the two, a coarse one ties their means ({J13})"
        )));
        checks.push(Check::new(
            format!("difference of their means over the overlap, {name} mediator"),
            tie.mean_difference,
            Accept::AtMost(1e-10),
        ));
        let t: Vec<f64> = tie.middle.iter().map(|m| m.0).collect();
        curves.push((
            format!("bar, {name} mediator"),
            t.clone(),
            tie.middle.iter().map(|m| m.1).collect(),
        ));
        curves.push((
            format!("chain, {name} mediator"),
            t,
            tie.middle.iter().map(|m| m.2).collect(),
        ));
    }
    let figure = Figure {
        file: "locking",
        title: "Velocity of both models in the middle of the overlap, steep pulse",
        axes: [["time over r/c", ""], ["velocity", ""]],
        log: [false, false],
        curves,
        says: "The papers see the velocities of the two models locked together by a fine mediator and tied only in the \
               mean by a coarse one. We see the same: the fine mediator forces the particles onto the bar's functions \
               (and reflects what these cannot follow), the coarse one leaves the particles their short waves."
            .into(),
    };
    Ok(Report {
        checks,
        figures: vec![figure],
    })
}
