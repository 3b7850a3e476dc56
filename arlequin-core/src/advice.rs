//! Advice before the first step: what an overlap is known to do badly, by measured ranges of the absorber and
//! of breaking bonds (decision 0022). Advice refuses nothing; callers report it.

use std::fmt;

/// Number of mediator elements across an overlap below which its bonds are loaded unevenly.
const LEAST_LAYERS: f64 = 2.0;

/// Smallest weight of the fine model below which the skin of an overlap is loaded above the body.
const LEAST_FLOOR: f64 = 0.05;

/// Coarse elements across the overlap from which the absorber is as good as measured.
const ABSORBER_WIDTH: f64 = 4.0;

/// Ratio of coarse element to fine spacing from which there are wavelengths well below the element.
const ABSORBER_RATIO: f64 = 4.0;

/// Relative error of a period that counts as resolved.
const PERIOD: f64 = 0.05;

/// `ω Δt` at which average acceleration, `tan(ω̃ Δt/2) = ω Δt/2`, makes periods too long by [`PERIOD`]: eight
/// steps a period.
const STEP_RESOLVES: f64 = 0.788;

/// `ω Δt_c` at which lumped elements with the critical step `Δt_c` make periods too long by [`PERIOD`]: six
/// elements a wave. They have `ω = (2/Δt_c) sin(kh/2)` where waves have `k c`.
const MESH_RESOLVES: f64 = 1.025;

/// Share by which a nearly incompressible body may be stiffer than a compressible one before locking is
/// reported.
const LOCKS: f64 = 0.05;

/// Share by which the relative error of a stress may exceed that of a compressible body before locking is
/// reported.
const STRESS_LOCKS: f64 = 0.1;

/// A choice of an overlap, a step or a material outside of the range that was measured. Lengths \[m\], times
/// \[s\].
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Advice {
    /// An absorber in an overlap that is few coarse elements wide.
    NarrowAbsorber {
        /// Width of the overlap.
        width: f64,
        /// Length of a coarse element.
        element: f64,
    },
    /// An absorber under a weight that jumps at the borders.
    JumpingWeight {
        /// Height of the jump, 0 to 1.
        jump: f64,
    },
    /// An absorber where no wave is much shorter than a coarse element.
    NoShortWaves {
        /// Length of a coarse element.
        element: f64,
        /// Spacing of the fine model.
        spacing: f64,
    },
    /// Breaking bonds where few mediator elements lie across the overlap.
    FewLayers {
        /// Width of the overlap.
        width: f64,
        /// Length of a mediator element.
        element: f64,
    },
    /// Breaking bonds where their weight almost vanishes.
    LowFloor {
        /// Smallest weight of the fine model.
        floor: f64,
    },
    /// Breaking bonds without an absorber.
    NoAbsorber,
    /// An implicit step that loses more than half of the frequencies that the mesh resolves.
    LongImplicitStep {
        /// Step of the model.
        step: f64,
        /// Critical step of the explicit scheme.
        critical: f64,
    },
    /// A nearly incompressible material in elements that lock.
    Locking {
        /// The elements, in the plural.
        elements: &'static str,
        /// Poisson's ratio.
        poisson: f64,
        /// Relative excess stiffness of a pressurised ring of these elements.
        stiffer: f64,
        /// Relative error of the largest stress in the ring.
        stress: f64,
    },
}

impl fmt::Display for Advice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Locking {
                elements,
                poisson,
                stiffer,
                stress,
            } => write!(
                f,
                "{elements} lock at a Poisson's ratio of {poisson}: a thick-walled ring under inner pressure with five of them \
                 through the wall comes out {:.0} % too stiff, with a hoop stress at the inner face that is off by {:.0} %; hold \
                 results against those of a finer mesh, or take a ratio of 0.45 or less",
                100.0 * stiffer,
                100.0 * stress.abs()
            ),
            Self::NarrowAbsorber { width, element } => write!(
                f,
                "the overlap is {:.2} coarse elements wide; the absorber takes 99.7 % of short waves from {ABSORBER_WIDTH} on \
                 and leaves 9 to 70 % below: widen the overlap to {:.3e} m or refine the coarse model",
                width / element,
                ABSORBER_WIDTH * element
            ),
            Self::JumpingWeight { jump } => write!(
                f,
                "the weight jumps by {jump} at the borders of the overlap, which reflects what the absorber should take: \
                 choose a weight without a jump (cubic)"
            ),
            Self::NoShortWaves { element, spacing } => write!(
                f,
                "a coarse element is {:.2} fine spacings long; the absorber takes waves well below the element only, and \
                 from {ABSORBER_RATIO} spacings on there are such: what is reflected will be more than 0.8 %",
                element / spacing
            ),
            Self::FewLayers { width, element } => write!(
                f,
                "{:.2} mediator elements lie across the overlap, and bonds can break in it: with one, bonds are loaded up to \
                 twice as hard as in a body of particles alone. Take at least {LEAST_LAYERS} (h_B <= {:.3e} m), better 4",
                width / element,
                width / LEAST_LAYERS
            ),
            Self::LowFloor { floor } => write!(
                f,
                "bonds can break in the overlap, and the smallest weight of their model is {floor:.1e}: below {LEAST_FLOOR} \
                 its skin is loaded up to 9 times as hard as the body and breaks first; take 0.1"
            ),
            Self::NoAbsorber => write!(
                f,
                "bonds can break in the overlap and it has no absorber: what breaking radiates stays in the particles and \
                 breaks more of them there; take rate_factor = 0.2"
            ),
            Self::LongImplicitStep { step, critical } => {
                let hertz = |resolves: f64, time: f64| resolves / (std::f64::consts::TAU * time);
                write!(
                    f,
                    "its implicit step of {step:.3e} s is {:.1} times the critical step that an explicit one would have: frequencies \
                     above {:.3e} Hz are not resolved by the step (their periods come out more than {:.0} % too long), though its \
                     mesh carries up to {:.3e} Hz; take a step of {:.3e} s where those matter",
                    step / critical,
                    hertz(STEP_RESOLVES, *step),
                    100.0 * PERIOD,
                    hertz(MESH_RESOLVES, *critical),
                    critical * STEP_RESOLVES / MESH_RESOLVES
                )
            }
        }
    }
}

/// Advice on breaking bonds in an overlap of `width` (if it has one), with mediator elements of length
/// `element`, a smallest weight `floor` of the bonds' model, and an absorber or none.
pub fn breakage(width: Option<f64>, element: f64, floor: f64, absorber: bool) -> Vec<Advice> {
    let mut out = Vec::new();
    // Widths a hundredth of an element too small still count.
    if let Some(width) = width.filter(|w| *w < (LEAST_LAYERS - 0.01) * element) {
        out.push(Advice::FewLayers { width, element });
    }
    if floor < LEAST_FLOOR {
        out.push(Advice::LowFloor { floor });
    }
    if !absorber {
        out.push(Advice::NoAbsorber);
    }
    out
}

/// Advice on locking of `elements` at a Poisson's ratio, if it matters.
///
/// The rows of `measured`, by rising ratio, hold Poisson's ratio, the relative excess stiffness of a
/// thick-walled ring under inner pressure, and the relative error of its hoop stress at the inner face.
/// Nothing locks in the first row. Values are interpolated over the logarithm of `1 − 2ν`; beyond the last
/// row its values hold.
pub fn locking(elements: &'static str, poisson: f64, measured: &[[f64; 3]]) -> Option<Advice> {
    // Locking goes with `λ/μ`, which is about `1/(1 − 2ν)` near one half.
    let place = |nu: f64| (1.0 - 2.0 * nu).ln();
    let after = measured.iter().position(|row| row[0] >= poisson);
    let [_, stiffer, stress] = match after.unwrap_or(measured.len()) {
        0 => *measured.first()?,
        k if k == measured.len() => *measured.last()?,
        k => {
            let (low, high) = (measured[k - 1], measured[k]);
            let share = (place(poisson) - place(low[0])) / (place(high[0]) - place(low[0]));
            [0, 1, 2].map(|c: usize| low[c] + share * (high[c] - low[c]))
        }
    };
    // The errors of the first row are those of the mesh: only what locking adds counts.
    let [_, sound, near] = *measured.first()?;
    let locks = stiffer - sound > LOCKS || stress.abs() - near.abs() > STRESS_LOCKS;
    locks.then_some(Advice::Locking {
        elements,
        poisson,
        stiffer,
        stress,
    })
}

/// Advice on an implicit step \[s\] that loses more than half of the frequencies that the mesh resolves;
/// `critical` is the critical step of the explicit scheme \[s\].
pub fn implicit(step: f64, critical: f64) -> Option<Advice> {
    // The highest frequencies that step and mesh resolve: less than half of the mesh's is left.
    let lost = STEP_RESOLVES / step < 0.5 * MESH_RESOLVES / critical;
    lost.then_some(Advice::LongImplicitStep { step, critical })
}

/// Advice on what makes an absorber reflect more than 0.8 % of short waves: a `jump` of the weight at its
/// borders, coarse elements of length `element`, a fine model of the given `spacing`.
pub fn absorber(width: Option<f64>, jump: f64, element: f64, spacing: f64) -> Vec<Advice> {
    let mut out = Vec::new();
    if jump > LEAST_FLOOR {
        out.push(Advice::JumpingWeight { jump });
    }
    if let Some(width) = width.filter(|w| *w < (ABSORBER_WIDTH - 0.01) * element) {
        out.push(Advice::NarrowAbsorber { width, element });
    }
    if element < ABSORBER_RATIO * spacing {
        out.push(Advice::NoShortWaves { element, spacing });
    }
    out
}

#[cfg(test)]
mod tests {
    use super::{Advice, MESH_RESOLVES, PERIOD, STEP_RESOLVES, absorber, breakage, implicit, locking};

    #[test]
    fn locking_is_told_from_a_twentieth_on_with_what_was_measured() {
        let rows = [[0.3, 0.02, 0.0], [0.45, 0.04, -0.1], [0.495, 0.24, -0.3]];
        assert_eq!(locking("cubes", 0.2, &rows), None);
        assert_eq!(locking("cubes", 0.45, &rows), None);
        // Stresses may be off where displacements are not.
        let soft = [[0.3, 0.01, 0.05], [0.49, 0.02, -0.16]];
        assert!(locking("cubes", 0.49, &soft).is_some() && locking("cubes", 0.4, &soft).is_none());
        let stiffer = |nu: f64| match locking("cubes", nu, &rows) {
            Some(Advice::Locking { stiffer, stress, .. }) => [stiffer, stress],
            _ => [0.0; 2],
        };
        // 1 − 2ν is 0.1, 0.0316, 0.01.
        let [middle, stress] = stiffer(0.5 - 0.5 * 0.001_f64.sqrt());
        assert!(
            (middle - 0.14).abs() < 1e-12 && (stress + 0.2).abs() < 1e-12,
            "{middle} {stress}"
        );
        let [last, stress] = stiffer(0.4999);
        assert!(
            (last - 0.24).abs() < 1e-12 && (stress + 0.3).abs() < 1e-12,
            "{last} {stress}"
        );
        let words = locking("cubes", 0.495, &rows)
            .map(|a| a.to_string())
            .unwrap_or_default();
        assert!(
            words.contains("24 % too stiff") && words.contains("off by 30 %"),
            "{words}"
        );
    }

    #[test]
    fn overlaps_in_which_breakage_is_right_are_not_warned_of_and_each_fault_is_named() {
        assert_eq!(breakage(Some(2.0), 1.0, 0.1, true), []);
        assert_eq!(breakage(None, 1.0, 0.1, true), []);
        let all = breakage(Some(1.0), 1.0, 1e-6, false);
        let wanted = [
            Advice::FewLayers {
                width: 1.0,
                element: 1.0,
            },
            Advice::LowFloor { floor: 1e-6 },
            Advice::NoAbsorber,
        ];
        assert_eq!(all, wanted);
        assert!(all[0].to_string().contains("5.000e-1 m"), "{}", all[0]);
    }

    #[test]
    fn limits_of_implicit_steps_are_where_periods_are_five_per_cent_too_long() {
        let half = 0.5 * STEP_RESOLVES;
        assert!((half / half.atan() - 1.0 - PERIOD).abs() < 5e-4);
        // Of waves of length 2π/k the mesh has ω = (2/Δt_c) sin(kh/2) in place of (2/Δt_c) kh/2.
        let half = 0.5 * MESH_RESOLVES;
        assert!((half.asin() / half - 1.0 - PERIOD).abs() < 5e-4);
    }

    #[test]
    fn implicit_steps_are_warned_of_beyond_one_and_a_half_critical_ones_with_what_they_lose() {
        assert_eq!([0.1, 1.0, 1.5].map(|r| implicit(r * 1e-6, 1e-6)), [None; 3]);
        let long = implicit(12e-6, 1e-6).map(|a| a.to_string()).unwrap_or_default();
        // 0.788/(2π 12 µs) and 1.025/(2π 1 µs).
        for word in [
            "12.0 times",
            "above 1.045e4 Hz",
            "5 % too long",
            "up to 1.631e5 Hz",
            "step of 7.688e-7 s",
        ] {
            assert!(long.contains(word), "{long}");
        }
        assert!(implicit(1.6e-6, 1e-6).is_some());
        assert_eq!(implicit(1.0, f64::INFINITY), None);
    }

    #[test]
    fn the_absorber_is_warned_of_outside_of_its_range() {
        assert_eq!(absorber(Some(4.0), 1e-6, 1.0, 0.1), []);
        assert_eq!(absorber(Some(2.0), 1e-6, 1.0, 0.1).len(), 1);
        assert_eq!(
            absorber(Some(4.0), 0.5, 1.0, 0.1),
            [Advice::JumpingWeight { jump: 0.5 }]
        );
        let short = absorber(Some(4.0), 0.0, 1.0, 0.5);
        assert!(
            short[0].to_string().contains("2.00 fine spacings"),
            "{}",
            short[0]
        );
    }
}
