//! Double cantilever at rest: the energy that a running crack takes, by the load, by the opening, by the
//! compliance and by the work of the grips.

use super::check::{Accept, Check};
use super::{Figure, Report, Runs, last, measured};
use crate::crack::{Broken, CrackPath, Plate, broken};
use arlequin_scene::{Result, Scene, Silent, Source};

const TEXT: &str = include_str!("../../scenes/double-cantilever.toml");
/// Length \[m\], height of an arm \[m\], thickness of the arms and between the grooves \[m\].
const BEAM: [f64; 4] = [40e-3, 6e-3, 3.6e-3, 1.8e-3];
/// Young's modulus \[Pa\], Poisson's ratio and fracture energy \[J/m²\] of the scene.
const SILICA: [f64; 3] = [72.5e9, 0.17, 8.0];
/// Length of the notch, and the last length that is measured: two arm heights before the end \[m\].
const ENDS: [f64; 2] = [14e-3, 28e-3];
/// Places before this one are those of the grips \[m\].
const GRIPS: f64 = 5e-3;
/// Middle of the grips \[m\].
const LOAD: f64 = 0.3e-3;
/// Largest opening \[m\].
const OPENING: f64 = 80e-6;
const DIAMETER: f64 = 0.6e-3;
const SEEDS: [u64; 3] = [1, 2, 3];
/// Distance from the groove beyond which a break belongs to an arm \[m\], and share of such breaks from which
/// on the crack has turned into the arm.
const ARM: [f64; 2] = [2e-3, 0.1];
/// Lengths of the crack of the finite elements \[m\].
const LENGTHS: [f64; 3] = [12e-3, 16e-3, 20e-3];

/// Root correction over the height of an arm: length `1/λ` of a beam on an elastic foundation, which is the
/// half of the arm beside the crack (`k = 2 E B/h`, `λ⁴ = k/(4 E I) = 6/h⁴`).
fn root() -> f64 {
    6.0_f64.powf(-0.25)
}

/// Energy released per area `12 F² (a + χ h)²/(E B B_n h³)` \[J/m²\], with the thickness `B_n` of the crack.
fn by_load(force: f64, crack: f64, net: f64) -> f64 {
    let [_, height, thickness, _] = BEAM;
    12.0 * (force * (crack + root() * height)).powi(2) / (SILICA[0] * thickness * net * height.powi(3))
}

/// Energy released per area `F²/(2 B_n) dC/da` \[J/m²\] for rows of crack length \[m\], load \[N\] and
/// opening \[m\]. The compliance follows `C = (p + s a)³`, fitted by least squares of its cube root (Berry
/// 1963): that of beams, with a stiffness and a root correction of its own in place of those of the closed
/// form.
fn by_compliance(rows: &[[f64; 3]], net: f64) -> Vec<f64> {
    let count = rows.len() as f64;
    let root = |r: &[f64; 3]| (r[2] / r[1]).cbrt();
    let mean = |f: &dyn Fn(&[f64; 3]) -> f64| rows.iter().map(f).sum::<f64>() / count;
    let (crack, middle) = (mean(&|r| r[0]), mean(&root));
    let along = mean(&|r| (r[0] - crack) * (root(r) - middle));
    let slope = along / mean(&|r| (r[0] - crack).powi(2));
    let release = |r: &[f64; 3]| {
        let fitted = middle + slope * (r[0] - crack);
        1.5 * r[1].powi(2) * slope * fitted.powi(2) / net
    };
    rows.iter().map(release).collect()
}

/// J \[J/m²\] of a double cantilever of finite elements over that of its load.
fn elements(crack: f64) -> Result<f64> {
    let ([length, height, thickness, _], [young, nu, _], e) = (BEAM, SILICA, 1e-5);
    let arm = |name: &str, low: f64, high: f64, sign: f64| {
        format!(
            "[[support]]\nname = \"{name}\"\nmodel = \"beam\"\ncomponents = [\"y\"]\nmotion = {{ amplitude = {sign:e}, time = \"step\" }}\n\
             where.box = {{ low = [0.0, {low:e}, 0.0], high = [0.0, {high:e}, {thickness:e}] }}\n"
        )
    };
    let text = format!(
        "[model.beam]\nkind = \"fem\"\ndivisions = [80, 24, 2]\n\
         shape.box = {{ low = [0.0, {:e}, 0.0], high = [{length:e}, {height:e}, {thickness:e}] }}\n\
         material = {{ young = {young:e}, poisson = {nu}, density = 1000.0 }}\n\
         crack = [{{ box = {{ low = [{:e}, {:e}, {:e}], high = [{:e}, {e:e}, {:e}] }} }}]\n{}{}\
         [[support]]\nmodel = \"beam\"\nwhere = \"x-max\"\ncomponents = [\"x\", \"z\"]\n\
         [static]\nsteps = 1\n\
         [probe.force]\nof = \"upper\"\nquantity = \"force\"\ncomponent = \"y\"\n\
         [probe.j]\nmodel = \"beam\"\nquantity = \"energy-release\"\n\
         crack = {{ front = [[{crack:e}, 0.0, 0.0], [{crack:e}, 0.0, {thickness:e}]], \
         direction = [1.0, 0.0, 0.0], radii = [1.2e-3, 4e-3] }}\n",
        -height,
        -e,
        -e,
        -e,
        crack + e,
        thickness + e,
        arm("upper", 0.5e-3, height, 1e-6),
        arm("lower", -height, -0.5e-3, -1e-6),
    );
    let results = Scene::from_text(text)?.prepare()?.run(&mut Silent)?;
    Ok(last(&results, "j")? / by_load(last(&results, "force")?, crack, thickness))
}

/// Energies per area of a running crack \[J/m²\].
#[derive(Debug, Clone)]
pub struct Taken {
    /// Work of the grips less the elastic energy `F δ/2`.
    pub lost: f64,
    /// Mean of the closed form of the load, over the length of the crack.
    pub by_load: f64,
    /// Mean of `3 F δ/(2 B_n (a + χ h))`, which needs no modulus.
    pub by_opening: f64,
    /// Mean of `F²/(2 B_n) dC/da` with the measured compliance `C = δ/F`.
    pub by_compliance: f64,
    /// Energy that the bonds released.
    pub released: f64,
    /// Share of the breaks that lie in an arm.
    pub strays: f64,
    /// Length of the crack \[m\] and closed form of the load \[J/m²\] at each load step with a running crack.
    pub steps: Vec<[f64; 2]>,
}

/// Returns the energies that the crack takes in one packing.
///
/// # Errors
/// A seed that the scene cannot take.
pub fn taken(seed: u64) -> Result<Taken> {
    let scene = Scene::from_source(Source::new("double-cantilever.toml", TEXT))?;
    let scene = scene.set("model.beam.dem.seed", seed)?;
    let results = scene.prepare()?.run(&mut Silent)?;
    let [_, height, _, net] = BEAM;
    let mut breaks: Vec<Broken> = broken(&results);
    breaks.retain(|b| b.place[0] > GRIPS);
    let strays = breaks.iter().filter(|b| b.place[1].abs() > ARM[0]).count();
    let strays = strays as f64 / breaks.len().max(1) as f64;
    let plate = Plate {
        ends: [ENDS[0], BEAM[0]],
        thickness: net,
        diameter: DIAMETER,
    };
    let path = CrackPath::new(plate, &breaks);
    // As many bonds break in every part of the ligament.
    let per_break = path.length() / breaks.len().max(1) as f64;
    let forces = measured(&results, "upper")?
        .iter()
        .zip(measured(&results, "lower")?);
    let forces: Vec<f64> = forces.map(|(u, l)| 0.5 * (u - l)).collect();
    let times = &results.recorded.probes.times;
    // Work of the grips; the law of the bonds is linear, so the elastic energy is half of load by opening.
    let (mut work, mut before) = (0.0, [0.0; 2]);
    let mut rows = Vec::new();
    for (time, force) in times.iter().zip(&forces) {
        let opening = OPENING * time;
        work += 0.5 * (force + before[1]) * (opening - before[0]);
        before = [opening, *force];
        let count = breaks.iter().filter(|b| b.time <= *time).count();
        let crack = ENDS[0] + per_break * count as f64;
        let lever = crack - LOAD;
        let closed = by_load(*force, lever, net);
        let open = 1.5 * force * opening / (net * (lever + root() * height));
        rows.push([crack, work - 0.5 * force * opening, closed, open, *force, opening]);
    }
    rows.retain(|r| r[0] > ENDS[0] && r[0] <= ENDS[1]);
    let measured: Vec<[f64; 3]> = rows.iter().map(|r| [r[0], r[4], r[5]]).collect();
    for (row, release) in rows.iter_mut().zip(by_compliance(&measured, net)) {
        row[4] = release;
    }
    let steps = rows.iter().map(|r| [r[0], r[2]]).collect();
    let (Some(first), Some(end)) = (rows.first(), rows.last()) else {
        return Ok(Taken {
            lost: f64::NAN,
            by_load: f64::NAN,
            by_opening: f64::NAN,
            by_compliance: f64::NAN,
            released: f64::NAN,
            strays,
            steps,
        });
    };
    let length = end[0] - first[0];
    let mean = |k: usize| {
        let area = rows
            .windows(2)
            .map(|w| 0.5 * (w[0][k] + w[1][k]) * (w[1][0] - w[0][0]));
        area.sum::<f64>() / length
    };
    Ok(Taken {
        lost: (end[1] - first[1]) / (length * net),
        by_load: mean(2),
        by_opening: mean(3),
        by_compliance: mean(4),
        released: path.released_per_area(),
        strays,
        steps,
    })
}

/// Compares the energies with each other and with the input.
pub(super) fn dcb(done: &Runs) -> Result<Report> {
    let seeds = if done.quick { &SEEDS[..1] } else { &SEEDS[..] };
    let lengths = if done.quick { &LENGTHS[1..2] } else { &LENGTHS[..] };
    let shares = lengths.iter().map(|a| elements(*a)).collect::<Result<Vec<_>>>()?;
    let all = seeds.iter().map(|s| taken(*s)).collect::<Result<Vec<_>>>()?;
    let stays = |t: &&Taken| t.strays <= ARM[1];
    let stayed = all.iter().filter(stays).count();
    // The closed form is that of a crack between the arms.
    let over = |f: &dyn Fn(&Taken) -> f64| all.iter().filter(stays).map(f).collect::<Vec<f64>>();
    let gc = SILICA[2];
    let closed = Check::over_seeds(
        "J of finite elements over the closed form of the load",
        &shares,
        Accept::Relative(0.05),
    );
    let row = |what: &str, values: &[f64], accept: Accept, source: &str| {
        Check::over_seeds(what, values, accept).beside(1.0, source)
    };
    let checks = vec![
        closed
            .note(format!("{} lengths", lengths.len()))
            .beside(1.0, "beam on an elastic foundation"),
        Check::against(
            "cracks that stay in the groove",
            stayed as f64,
            all.len() as f64,
            "our expectation",
            Accept::Absolute(0.0),
        ),
        row(
            "energy by load over energy lost",
            &over(&|t| t.by_load / t.lost),
            Accept::Relative(0.1),
            "two ways to one energy",
        ),
        row(
            "energy by opening over energy lost",
            &over(&|t| t.by_opening / t.lost),
            Accept::Relative(0.1),
            "two ways to one energy",
        ),
        row(
            "energy by compliance over energy lost",
            &over(&|t| t.by_compliance / t.lost),
            Accept::Relative(0.1),
            "two ways to one energy",
        ),
        row(
            "energy lost per area over gc",
            &over(&|t| t.lost / gc),
            Accept::Relative(0.12),
            "input",
        ),
        row(
            "released energy per area over gc",
            &over(&|t| t.released / gc),
            Accept::Relative(0.12),
            "input",
        ),
    ];
    let curve = |(seed, t): (&u64, &Taken)| {
        let of = |k: usize, scale: f64| t.steps.iter().map(|s| scale * s[k]).collect();
        (format!("seed {seed}"), of(0, 1e3), of(1, 1.0))
    };
    let figure = Figure {
        file: "dcb",
        title: "Energy released by the crack of a double cantilever, from its load",
        axes: [["crack", "mm"], ["G", "J/m2"]],
        log: [false; 2],
        curves: seeds.iter().zip(&all).map(curve).collect(),
        says: String::new(),
    };
    Ok(Report {
        checks,
        figures: vec![figure],
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows of crack, load and opening under which a beam of any stiffness and root correction takes 5 J/m².
    #[test]
    fn ways_to_the_energy_of_a_beam_agree() {
        let [_, height, thickness, net] = BEAM;
        let row = |k: usize, young: f64, root: f64| {
            let lever = 14e-3 + 1e-3 * k as f64 - LOAD + root * height;
            // `C = 8 (a + χ h)³/(E B h³)`.
            let compliance = 8.0 * lever.powi(3) / (young * thickness * height.powi(3));
            let slope = 3.0 * compliance / lever;
            let force = (2.0 * net * 5.0 / slope).sqrt();
            [lever + LOAD - root * height, force, force * compliance]
        };
        for (young, root) in [(SILICA[0], root()), (60e9, 1.0)] {
            let rows: Vec<[f64; 3]> = (0..10).map(|k| row(k, young, root)).collect();
            let found = by_compliance(&rows, net);
            assert!(found.iter().all(|g| (g / 5.0 - 1.0).abs() < 1e-9), "{found:?}");
        }
        let [crack, force, opening] = row(3, SILICA[0], root());
        assert!((by_load(force, crack - LOAD, net) / 5.0 - 1.0).abs() < 1e-9);
        let open = 1.5 * force * opening / (net * (crack - LOAD + root() * height));
        assert!((open / 5.0 - 1.0).abs() < 1e-9);
        // The root of a beam on an elastic foundation: `λ⁴ = k/(4 E I)` with `k = 2 E B/h`, `I = B h³/12`.
        assert!((root().powi(-4) - 6.0).abs() < 1e-12);
    }
}
