//! Cost model, measured on this machine, and the search for the best candidate.

use super::mesher::Elements;
use super::predict::{self, Candidate, Errors, Form, Table};
use super::scenario::{OverlapKind, Scenario, Spectrum};
use crate::error::Result;
use crate::spec::{JunctionKind, ProfileKind};
use arlequin::core::TimeStep;

/// Widths of the overlap to try, in coarse elements: fewer than three reflect long waves.
const WIDTHS: [f64; 4] = [3.0, 4.0, 6.0, 8.0];
/// Widths for a zone: its borders lie between elements, so that the overlap may be half an element narrower.
const ZONE_WIDTHS: [f64; 4] = [3.5, 4.0, 6.0, 8.0];
/// Mediator spacings to try, in coarse spacings.
const MEDIATORS: [f64; 2] = [1.0, 0.5];
/// Weight profiles to try.
const PROFILES: [ProfileKind; 3] = [ProfileKind::Cubic, ProfileKind::Quintic, ProfileKind::Linear];
/// Junction lengths to try, in mediator spacings: beyond 0.5, the condition number grows as the fourth power
/// of the length.
const LENGTHS: [f64; 2] = [0.25, 0.5];
/// Ratio of neighbouring coarse spacings to try.
const SPACING_STEP: f64 = 1.12;

/// Results of trial steps with a scene.
#[derive(Debug, Clone, Copy)]
pub(super) struct Measured {
    /// Numbers of nodes of the coarse and of the fine model.
    pub nodes: [f64; 2],
    /// Numbers of coupled nodes of the coarse and of the fine model, and of multipliers.
    pub coupled: [f64; 3],
    /// Seconds per step of the run: coarse model, fine model, interface, rest.
    pub seconds: [f64; 4],
    /// Set-up time \[s\].
    pub setup: f64,
    /// Own step of the finest model \[s\].
    pub dt: f64,
    /// Own steps of the coarse and of the fine model per step of the run.
    pub own_steps: [f64; 2],
    /// Own steps of the finest model per step of the run.
    pub most: f64,
    /// Critical steps of the coarse and of the fine model \[s\].
    pub critical: [f64; 2],
}

/// Measured cost of one scene, scaled to others by the amount of work.
#[derive(Debug, Clone)]
pub(super) struct CostModel {
    base: Candidate,
    measured: Measured,
    dimension: i32,
    fraction: f64,
}

impl CostModel {
    /// Uses a measurement of the scene at `base`; candidates take steps of `fraction` of the critical step.
    pub(super) fn new(base: Candidate, measured: Measured, s: &Scenario, fraction: f64) -> Self {
        Self {
            base,
            measured,
            dimension: if s.across.is_some() { 3 } else { 1 },
            fraction,
        }
    }

    /// Returns the own step of the finest model of a candidate \[s\].
    pub(super) fn dt(&self, c: &Candidate) -> f64 {
        // The critical step of a lattice is proportional to its spacing.
        let [coarse, fine] = self.critical(c);
        self.fraction * fine.min(coarse)
    }

    /// Returns the critical steps of the coarse and of the fine model of a candidate \[s\].
    fn critical(&self, c: &Candidate) -> [f64; 2] {
        let [coarse, fine] = self.measured.critical;
        [coarse * c.h / self.base.h, fine * c.r / self.base.r]
    }

    /// Returns the step of the run \[s\], and the own steps of both models in it.
    fn pace(&self, c: &Candidate, s: &Scenario) -> (f64, [f64; 2]) {
        match TimeStep::chosen(self.fraction, &self.critical(c)) {
            Ok((dt, own_steps)) if s.free_steps => (dt, [0, 1].map(|k| own_steps[k] as f64)),
            // A step, or own steps, that the scene gives stay as they are.
            _ => (self.measured.most * self.dt(c), self.measured.own_steps),
        }
    }

    /// Returns the time of all steps and of the set-up \[s\].
    pub(super) fn seconds(&self, c: &Candidate, s: &Scenario, end: f64) -> f64 {
        let (m, b) = (&self.measured, &self.base);
        let d = self.dimension;
        // Numbers of nodes grow with the power of the dimension.
        let shrink = (b.h / c.h).powi(d);
        let finer = (b.r / c.r).powi(d);
        let (sizes, given) = (s.sizes(c.overlap), s.sizes(b.overlap));
        let wider = sizes[1] / given[1];
        let fine = sizes[0] / given[0] * finer;
        // In space, a solve with a banded factor grows faster than the number of unknowns.
        let power = if d == 3 { 4.0 / 3.0 } else { 1.0 };
        let multipliers = wider * (b.h_b / c.h_b).powi(d);
        let work = |n: [f64; 3]| n[0] + n[1] + n[2].powf(power);
        let grown = [
            m.coupled[0] * wider * shrink,
            m.coupled[1] * wider * finer,
            m.coupled[2] * multipliers,
        ];
        let interface = work(grown) / work(m.coupled).max(1.0);
        let nodes = (m.nodes[0] * shrink + m.nodes[1] * fine) / (m.nodes[0] + m.nodes[1]);
        let (dt, own_steps) = self.pace(c, s);
        let models = m.seconds[0] * shrink * own_steps[0] / m.own_steps[0]
            + m.seconds[1] * fine * own_steps[1] / m.own_steps[1];
        let step = models + m.seconds[2] * interface + m.seconds[3] * nodes;
        (end / dt).ceil() * step + m.setup * nodes
    }
}

/// A candidate with its predicted error and time.
#[derive(Debug, Clone, Copy)]
pub(super) struct Prospect {
    /// Settings.
    pub candidate: Candidate,
    /// Errors.
    pub errors: Errors,
    /// Time \[s\].
    pub seconds: f64,
}

/// Target of a proposal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Goal {
    /// Least time within an error \[–\].
    Error(f64),
    /// Least error within a time \[s\].
    Time(f64),
}

impl Goal {
    /// Returns whether a prospect meets the goal.
    pub(super) fn is_met(self, p: &Prospect) -> bool {
        match self {
            Self::Error(e) => p.errors.worst() <= e,
            Self::Time(t) => p.seconds <= t,
        }
    }
}

/// All candidates for a scene, with the reflection of their overlaps.
#[derive(Debug)]
pub(super) struct Search<'a> {
    /// Lengths and materials of the scene.
    pub scenario: &'a Scenario,
    /// Spectrum of the signal.
    pub spectrum: &'a Spectrum,
    /// End of the run \[s\].
    pub end: f64,
    /// Candidate with the settings of the scene.
    pub given: Candidate,
    /// Tables of loss over frequency, one per form of overlap.
    pub tables: Vec<Table>,
    candidates: Vec<Candidate>,
}

impl<'a> Search<'a> {
    /// Lists the candidates and analyses their overlaps.
    pub(super) fn new(scenario: &'a Scenario, spectrum: &'a Spectrum, end: f64) -> Result<Self> {
        let s = scenario;
        let (given, form) = as_given(s);
        let mut forms = vec![form];
        let mut candidates = match s.kind {
            OverlapKind::Slab => Vec::new(),
            // Widths that suit a small body may be narrower than those tried here.
            _ => vec![given],
        };
        // The coarse model keeps at least two elements across and four along.
        let most = (s.lengths[0] / 4.0).min(s.across.unwrap_or(f64::INFINITY) / 2.0);
        let least = s.halved_to.unwrap_or(s.spacings[1]);
        for (spacing, elements) in s.mesher.spacings([most, least], SPACING_STEP, rounded) {
            for form in overlaps_to_try(s, &elements) {
                let new = candidate(s, &form, spacing, &elements, 0);
                let width = s.movable.then_some(new.overlap);
                let mediator = spacing * form.h_b;
                if s.frame.as_ref().is_some_and(|f| !f.fits(width, mediator)) {
                    continue;
                }
                // Overlaps that reflect alike share one harmonic analysis, the expensive part.
                let known = forms.iter().position(|f| reflect_alike(f, &form));
                let table = known.unwrap_or_else(|| {
                    forms.push(form);
                    forms.len() - 1
                });
                candidates.push(Candidate { table, ..new });
            }
        }
        Ok(Self {
            scenario,
            spectrum,
            end,
            given,
            tables: predict::tables(&forms)?,
            candidates,
        })
    }

    /// Predicts errors and time of a candidate.
    pub(super) fn predict(&self, c: &Candidate, costs: &CostModel, dt: f64) -> Prospect {
        let errors = predict::errors(c, &self.tables, self.scenario, self.spectrum, self.end, dt);
        Prospect {
            candidate: *c,
            errors,
            seconds: costs.seconds(c, self.scenario, self.end),
        }
    }

    /// Returns the best candidate except for those that are made like a dropped one.
    pub(super) fn best(
        &self,
        goal: Goal,
        costs: &CostModel,
        dropped: &[Candidate],
    ) -> std::result::Result<Prospect, Option<Prospect>> {
        let predict = |c| self.predict(c, costs, costs.dt(c));
        let prospects: Vec<Prospect> = {
            let kept = |c: &&Candidate| !dropped.iter().any(|d| d.is_made_like(c));
            self.candidates.iter().filter(kept).map(predict).collect()
        };
        let least = |f: &dyn Fn(&Prospect) -> f64, keep: &dyn Fn(&Prospect) -> bool| {
            let eligible = prospects.iter().filter(|p| keep(p));
            eligible.min_by(|a, b| f(a).total_cmp(&f(b))).copied()
        };
        let error = |p: &Prospect| p.errors.worst();
        let time = |p: &Prospect| p.seconds;
        // If none is eligible, the error message names the nearest.
        match goal {
            Goal::Error(e) => least(&time, &|p| error(p) <= e).ok_or_else(|| least(&error, &|_| true)),
            Goal::Time(t) => least(&error, &|p| time(p) <= t).ok_or_else(|| least(&time, &|_| true)),
        }
    }
}

/// Returns the candidate with the settings of the scene, whose overlap is the first table.
pub(super) fn as_given(s: &Scenario) -> (Candidate, Form) {
    let [h, _, h_b] = s.spacings;
    let form = Form {
        ratio: (h / s.fine_spacing(h)).max(1.0),
        h_b: h_b / h,
        overlap: s.overlap / h,
        profile: s.profile,
        junction: s.junction,
        length_ratio: (s.junction != JunctionKind::L2).then_some(s.length_ratio),
    };
    let given = Candidate {
        h,
        spacing: h,
        r: s.fine_spacing(h),
        h_b,
        overlap: s.overlap,
        profile: form.profile,
        length_ratio: form.length_ratio,
        table: 0,
    };
    (given, form)
}

fn candidate(s: &Scenario, f: &Form, spacing: f64, e: &Elements, table: usize) -> Candidate {
    Candidate {
        h: e.h,
        spacing,
        r: s.fine_spacing(e.h),
        h_b: f.h_b * e.h,
        overlap: if s.movable {
            f.overlap * edge(s, e)
        } else {
            s.overlap
        },
        profile: f.profile,
        length_ratio: f.length_ratio,
        table,
    }
}

/// Returns the length of a coarse element by which the width of an overlap is judged \[m\].
pub(super) fn edge(s: &Scenario, e: &Elements) -> f64 {
    (e.mean * s.stretch).max(e.h)
}

/// Rounds a spacing to four digits, which are more than it needs.
pub(super) fn rounded(x: f64) -> f64 {
    format!("{x:.3e}").parse().unwrap_or(x)
}

/// Returns whether two overlaps reflect alike.
fn reflect_alike(a: &Form, b: &Form) -> bool {
    let close = |x: f64, y: f64| (x / y).ln().abs() < 0.02;
    // Above 10, the ratio of the spacings hardly matters.
    close(a.ratio.min(10.0), b.ratio.min(10.0))
        && close(a.overlap, b.overlap)
        && close(a.h_b, b.h_b)
        && (a.profile, a.length_ratio) == (b.profile, b.length_ratio)
}

/// Returns the overlaps to try with coarse elements.
fn overlaps_to_try(s: &Scenario, elements: &Elements) -> Vec<Form> {
    let (h, edge) = (elements.h, edge(s, elements));
    let r = s.fine_spacing(h);
    let widths = match (s.movable, s.kind) {
        (false, _) => vec![s.overlap / h],
        (true, OverlapKind::Zone) => ZONE_WIDTHS.to_vec(),
        (true, _) => WIDTHS.to_vec(),
    };
    // The analysis is of plane borders; which weight suits borders with corners, it does not know.
    let profiles = match s.kind {
        OverlapKind::Slab => PROFILES.to_vec(),
        _ => vec![s.profile],
    };
    let lengths: Vec<Option<f64>> = if s.junction == JunctionKind::L2 {
        vec![None]
    } else {
        LENGTHS.map(Some).to_vec()
    };
    // Few ratios, because every form of overlap needs an analysis.
    let ratio = [1.0f64, 1.5, 2.0, 3.0, 5.0, 10.0]
        .into_iter()
        .rfind(|x| *x <= h / r * 1.01)
        .unwrap_or(1.0);
    let mut out = Vec::new();
    for overlap in widths {
        let too_wide = s.movable && overlap * edge > 0.5 * s.lengths[0];
        // The margin covers the rounding of the ends when they are written.
        let too_narrow = s.movable && overlap * edge < s.needed * (1.0 + 1e-6);
        if too_wide || too_narrow || !(1.0..=40.0).contains(&overlap) {
            continue;
        }
        // Multipliers finer than two particles tie motions that should stay free.
        for h_b in MEDIATORS.into_iter().filter(|b| *b >= 1.0 || b * h >= 2.0 * r) {
            for &profile in &profiles {
                out.extend(lengths.iter().map(|l| Form {
                    ratio,
                    h_b,
                    overlap,
                    profile,
                    junction: s.junction,
                    length_ratio: *l,
                }));
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn costs(critical: [f64; 2]) -> (CostModel, Candidate, Scenario) {
        let scene = "[model.a]\nkind = \"fem\"\nrole = \"coarse\"\nshape.bar = { from = 0, to = 9, section = 1 }\n\
             spacing = 0.5\nmaterial = { young = 1, density = 1 }\n\
             [model.b]\nkind = \"chain\"\nrole = \"fine\"\nshape.bar = { from = -9, to = 2, section = 1 }\n\
             spacing = 0.1\nmaterial = { young = 1, density = 1 }\n\
             [interface.j]\ncoarse = \"a\"\nfine = \"b\"\n\
             overlap.slab = { fine = [0, 0, 0], coarse = [2, 0, 0] }\nweight = { profile = \"cubic\" }\n[time]\nend = 1\n";
        let scene = crate::scene::Scene::from_text(scene).expect("a scene");
        let s = super::super::scenario::scenario(scene.spec()).expect("a scenario");
        let (given, _) = as_given(&s);
        let measured = Measured {
            nodes: [19.0, 111.0],
            coupled: [5.0, 21.0, 5.0],
            seconds: [1e-6, 2e-6, 1e-6, 1e-6],
            setup: 1e-3,
            dt: 0.05,
            own_steps: [1.0; 2],
            most: 1.0,
            critical,
        };
        (CostModel::new(given, measured, &s, 0.9), given, s)
    }

    #[test]
    fn overlaps_keep_the_fine_model_where_its_probes_look() {
        let (.., mut s) = costs([0.5, 0.8]);
        let least = |s: &Scenario| {
            let half = Elements {
                counts: vec![18],
                h: 0.5,
                mean: 0.5,
            };
            overlaps_to_try(s, &half)
                .iter()
                .map(|f| 0.5 * f.overlap)
                .fold(f64::INFINITY, f64::min)
        };
        assert!((least(&s) - 1.5).abs() < 1e-12);
        s.needed = 1.7;
        assert!((least(&s) - 2.0).abs() < 1e-12);
        s.movable = false;
        assert!((least(&s) - 2.0).abs() < 1e-12, "a width that stays has them");
    }

    /// An explicit step shrinks with the spacing that limits it: half a limiting coarse spacing takes twice
    /// the steps, whereas under a limiting fine spacing the step stays.
    #[test]
    fn the_step_shrinks_with_the_spacing_that_limits_it() {
        let (model, given, _) = costs([0.5, 0.8]);
        for factor in [1.0, 0.5, 0.25] {
            let h = given.h * factor;
            let dt = model.dt(&Candidate { h, ..given });
            assert!((dt / (0.9 * 0.5 * factor) - 1.0).abs() < 1e-12, "h = {h}: {dt}");
        }
        assert!(
            (model.dt(&Candidate {
                h: 2.0 * given.h,
                ..given
            }) - 0.9 * 0.8)
                .abs()
                < 1e-12
        );
        let (model, given, s) = costs([0.5, 0.1]);
        let half = Candidate {
            h: 0.5 * given.h,
            ..given
        };
        assert!((model.dt(&half) - 0.09).abs() < 1e-12 && (model.dt(&given) - 0.09).abs() < 1e-12);
        // Half of the coarse critical step has room for two fine ones, of half the spacing for one.
        let near = |(dt, own_steps): (f64, [f64; 2]), expected: (f64, [f64; 2])| {
            assert!(
                (dt - expected.0).abs() < 1e-12
                    && own_steps
                        .iter()
                        .zip(expected.1)
                        .all(|(a, b)| (a - b).abs() < 1e-12),
                "{dt} {own_steps:?}"
            );
        };
        near(model.pace(&given, &s), (0.18, [1.0, 2.0]));
        near(model.pace(&half, &s), (0.09, [1.0, 1.0]));
    }
}
