//! Toughness of strips: the energy that a slow crack takes, measured in three ways.

use super::sample::{Sample, Test};
use super::strip::Meant;
use super::{Elastic, Estimate, KEY, with_progress};
use crate::Progress;
use crate::error::{Result, key};
use crate::run::Silent;
use crate::scene::Scene;
use crate::setup::filling::dem;
use arlequin::dem_beam::calibrate::{Elasticity, Spread};
use arlequin::dem_beam::fracture::{diameter_of_both, tensile_strength};
use arlequin::dem_beam::packing::Packing;
use arlequin::dem_beam::toughness::{Strip, Toughness, toughness_test};
use serde::Serialize;

/// Largest relative difference between the three ways of measuring.
const AGREE: f64 = 0.1;
/// Relative difference above which the three ways do not measure the same quantity.
const APART: f64 = 0.5;
/// Largest relative difference between the fracture energy of a scene and that measured, without a warning.
const NEAR: f64 = 0.15;
/// Largest speed of a slow crack over that of waves; the clamps ask for a fiftieth.
const SLOW: f64 = 0.2;
/// Elements of the twin across the height of the strip.
const TWIN: usize = 16;

/// Settings of a toughness test.
#[derive(Debug, Clone, Default)]
pub struct ToughnessTest {
    /// Strength in tension that the body should have \[Pa\].
    pub body_strength: Option<f64>,
}

/// Crack of one strip. Energies are per area of the crack in its plane \[J/m²\].
#[derive(Debug, Clone, Serialize)]
pub struct StripTest {
    /// Seed of the packing; `None` for spheres from a file.
    pub seed: Option<u64>,
    /// Elongation of the strip while the crack runs \[m\].
    pub elongation: f64,
    /// J of the finite-element twin at this elongation.
    pub j: f64,
    /// Energy that the strip lost: released with bonds, or left as waves.
    pub lost: f64,
    /// Part of `lost` that left with the bonds.
    pub released: f64,
    /// Strip theory at this elongation.
    pub theory: f64,
    /// Strip theory at the first broken bond.
    pub first: f64,
    /// Broken bonds per area \[1/m²\].
    pub broken: f64,
    /// Speed of the crack over that of waves.
    pub speed: f64,
}

/// Results of a toughness test.
#[derive(Debug, Clone, Serialize)]
pub struct ToughnessResult {
    /// Criterion of the bonds.
    pub criterion: &'static str,
    /// Strength of the bonds \[Pa, or J/m² for energies\].
    pub bond_strength: f64,
    /// Fracture energy that the bonds are meant for \[J/m²\]; `None` where a strength is given.
    pub gc: Option<f64>,
    /// Lengths of the strip \[m\].
    pub strip: [f64; 3],
    /// Mean diameter of the spheres \[m\].
    pub diameter: f64,
    /// Results of each strip.
    pub strips: Vec<StripTest>,
    /// J of the twin, over the strips \[J/m²\].
    pub j: Estimate,
    /// Energy lost by the strip \[J/m²\].
    pub lost: Estimate,
    /// Energy released with the bonds \[J/m²\].
    pub released: Estimate,
    /// Strip theory \[J/m²\].
    pub theory: Estimate,
    /// Largest relative difference between the means of `j`, `lost` and `theory`.
    pub difference: f64,
    /// Strength in tension of a plain body that follows from `released` \[Pa\]; energy criteria only.
    pub tensile_strength: Option<f64>,
    /// Mean diameter \[m\] at which a body has this toughness and the wanted strength.
    pub diameter_of_both: Option<f64>,
}

/// Lets a crack run through each strip.
pub(super) fn test_toughness(
    asked: &ToughnessTest,
    sample: &Sample,
    packings: &[Packing],
    (bars, elastic): (&[Elasticity], &Elastic),
    progress: Progress<'_>,
) -> Result<ToughnessResult> {
    let Test::Strip(_, low, size) = sample.test else {
        return Err(key(KEY, "toughness is that of a strip; remove --periodic"));
    };
    let nu = elastic.poisson.mean;
    let Some(Meant { gc, fracture }) = sample.meant else {
        return Err(key(KEY, "a strip has no fracture; report this"));
    };
    let strip = |young: f64| Strip { low, size, young };
    let seeds = sample.recipes.iter().map(|r| r.0);
    let work: Vec<_> = seeds.zip(packings).zip(bars).collect();
    let strips = with_progress(work.into_iter(), "strips", progress, |((seed, packing), bar)| {
        // With the modulus of this packing: packings of other seeds have others.
        let strip = strip(bar.young);
        let test = toughness_test(packing, sample.beam, &strip, fracture).map_err(dem(&sample.key))?;
        let j = twin(&strip, test.height, nu)? * test.elongation.powi(2);
        Ok(line(seed, &strip, nu, j, &test))
    })?;
    let mean = |f: fn(&StripTest) -> f64| {
        Estimate::from(Spread::from_samples(&strips.iter().map(f).collect::<Vec<_>>()))
    };
    let (j, lost, theory) = (mean(|s| s.j), mean(|s| s.lost), mean(|s| s.theory));
    let means = [j, lost, theory].map(|e| e.mean);
    let [low, high] = means
        .iter()
        .fold([f64::INFINITY, 0.0], |[a, b], x| [x.min(a), x.max(b)]);
    let diameters: Vec<f64> = packings.iter().map(|p| 2.0 * p.report.mean_radius).collect();
    let diameter = Spread::from_samples(&diameters).mean;
    let released = mean(|s| s.released);
    let energy = fracture.criterion.is_energy();
    Ok(ToughnessResult {
        criterion: fracture.criterion.name(),
        bond_strength: fracture.strength,
        gc,
        strip: size,
        diameter,
        j,
        lost,
        released,
        theory,
        difference: high / low - 1.0,
        tensile_strength: energy.then(|| tensile_strength(elastic.young.mean, released.mean, diameter)),
        diameter_of_both: asked
            .body_strength
            .map(|strength| diameter_of_both(elastic.young.mean, released.mean, strength)),
        strips,
    })
}

fn line(seed: Option<u64>, strip: &Strip, nu: f64, j: f64, test: &Toughness) -> StripTest {
    // Plane stress, between clamps that keep the strip from narrowing along the crack.
    let theory = |u: f64| strip.young * u * u / (2.0 * test.height * (1.0 - nu * nu));
    StripTest {
        seed,
        elongation: test.elongation,
        j,
        lost: test.lost,
        released: test.released,
        theory: theory(test.elongation),
        first: theory(test.first),
        broken: test.broken,
        speed: test.speed,
    }
}

/// Returns J over the square of the elongation \[J/m⁴\] of a strip of finite elements, as high as the spheres
/// between their clamps, with the crack in the middle of the measured length.
fn twin(strip: &Strip, height: f64, nu: f64) -> Result<f64> {
    let [length, _, thickness] = strip.size;
    let element = height / TWIN as f64;
    let count = |x: f64| ((x / element).round() as usize).max(2);
    let along = count(length);
    let [from, to] = strip.measured();
    // The front lies on a line of the mesh.
    let step = length / along as f64;
    let front = ((0.5 * (from + to) - strip.low[0]) / step).round() * step;
    // The box of the crack must hold the nodes of its plane, and no others.
    let (middle, slack) = (0.5 * height, 0.01 * element);
    // Statics is linear: J over the square of one elongation holds for all.
    let elongation = 1e-4 * height;
    let text = format!(
        "[model.strip]\nkind = \"fem\"\ndivisions = [{along}, {TWIN}, {}]\n\
         shape.box = {{ low = [0.0, 0.0, 0.0], high = [{length:e}, {height:e}, {thickness:e}] }}\n\
         material = {{ young = {:e}, poisson = {nu:e}, density = 1000.0 }}\n\
         crack = [{{ box = {{ low = [{:e}, {:e}, {:e}], high = [{:e}, {:e}, {:e}] }} }}]\n\
         [[support]]\nmodel = \"strip\"\nwhere = \"y-min\"\n\
         [[support]]\nmodel = \"strip\"\nwhere = \"y-max\"\ncomponents = [\"x\", \"z\"]\n\
         [[support]]\nmodel = \"strip\"\nwhere = \"y-max\"\ncomponents = [\"y\"]\n\
         motion = {{ amplitude = {elongation:e}, time = \"step\" }}\n\
         [static]\nsteps = 1\n\
         [probe.j]\nmodel = \"strip\"\nquantity = \"energy-release\"\n\
         crack = {{ front = [[{front:e}, {middle:e}, 0.0], [{front:e}, {middle:e}, {thickness:e}]], \
         direction = [1.0, 0.0, 0.0], radii = [{:e}, {:e}] }}\n",
        count(thickness),
        strip.young,
        -slack,
        middle - slack,
        -slack,
        front + slack,
        middle + slack,
        thickness + slack,
        2.0 * element,
        5.0 * element,
    );
    let results = Scene::from_text(text)?.prepare()?.run(&mut Silent)?;
    let j = results.probe("j").and_then(|p| p.1.last().copied());
    j.map(|j| j / elongation.powi(2))
        .ok_or_else(|| key(KEY, "the twin of finite elements has no J; report this"))
}

impl ToughnessResult {
    /// Returns warnings: ways that disagree, a fracture energy that is not reached, a strength that does not
    /// go with the toughness.
    pub(super) fn warnings(&self, asked: &ToughnessTest) -> Vec<String> {
        let mut out = Vec::new();
        if self.difference > APART {
            out.push(format!(
                "the three ways to the energy per area differ by {:.0} %: no figure above is a fracture energy. Bonds broke beside \
                 the crack, or it did not cross the measured length; criteria of stresses with scattered strengths do this. Take \
                 gc, or a strength without scatter",
                100.0 * self.difference
            ));
        } else if self.difference > AGREE {
            out.push(format!(
                "the three ways to the energy per area differ by {:.0} %, more than {:.0} %: take more packings or a longer \
                 strip",
                100.0 * self.difference,
                100.0 * AGREE
            ));
        }
        let run_away = self.strips.iter().filter(|s| s.speed > SLOW).count();
        if run_away > 0 {
            out.push(format!(
                "in {run_away} of {} strips the crack ran away, faster than {SLOW} wave speeds: their figures are those of a fast \
                 crack; take smaller spheres or a higher strip",
                self.strips.len()
            ));
        }
        if let Some(gc) = self.gc.filter(|gc| (self.released.mean / gc - 1.0).abs() > NEAR) {
            out.push(format!(
                "the bonds release {:.3e} J/m2, gc = {gc:e} J/m2 was asked for",
                self.released.mean
            ));
        }
        if let (Some(strength), Some(both)) = (asked.body_strength, self.diameter_of_both)
            && (both / self.diameter - 1.0).abs() > NEAR
        {
            out.push(format!(
                "a body of spheres of {:.3e} m cannot have {:.3e} J/m2 and {strength:e} Pa: both hold with spheres of {both:.2e} \
                 m only",
                self.diameter, self.released.mean
            ));
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A long strip of finite elements releases `E u²/(2 (1 − ν²) H)`, whatever the length of its crack.
    #[test]
    fn the_twin_releases_what_strip_theory_says() {
        let [nu, height, u] = [0.3, 9e-3, 2e-6];
        let strip = Strip {
            low: [0.0; 3],
            size: [40e-3, 10e-3, 1.2e-3],
            young: 70e9,
        };
        let test = Toughness {
            height,
            elongation: u,
            first: 0.5 * u,
            lost: 1.0,
            released: 1.0,
            broken: 1.0,
            speed: 0.01,
        };
        let j = twin(&strip, height, nu).expect("a twin") * u * u;
        let row = line(Some(1), &strip, nu, j, &test);
        let theory = 70e9 * u * u / (2.0 * (1.0 - nu * nu) * height);
        assert!((row.theory / theory - 1.0).abs() < 1e-12, "{row:?}");
        assert!((row.first / theory - 0.25).abs() < 1e-12, "{row:?}");
        assert!((row.j / theory - 1.0).abs() < 0.03, "{row:?}");
    }
}
