//! Forces and energies of bonds under small rotations, eight bonds at a time: divisions and square roots
//! bound the pass over all bonds, and eight of them take little longer than one.
//!
//! No product is fused with a sum, so that all values have the bits of those of
//! [`LinearBond`](crate::bond::LinearBond), one bond after the other.

use super::DemModel;
use super::poses::Reader;
use super::recovery::Carried;
use crate::bond::BeamRigidity;
use crate::fracture::BreakLog;
use crate::fracture::criterion::Strains;
use crate::fracture::state::FractureState;
use crate::kernel::engine::{OnLanes, With, prefetch_lines};
use crate::kernel::lanes::{Job, LANES, Lanes, Vec3, diff, plain_cross, plain_dot, scale, sum};
use arlequin_core::SymmetricTensor;

/// Number of bonds between the one that is read and the one that is prefetched.
const AHEAD: usize = 2 * LANES;

/// A number of each of eight bonds.
type Lane = [f64; LANES];

/// Reads consecutive bonds of a model under small rotations.
pub(super) struct Octets<'a> {
    pub(super) model: &'a DemModel,
    pub(super) reader: &'a Reader<'a>,
    pub(super) broken: &'a BreakLog,
    /// Strengths under a criterion of bonds.
    pub(super) strength: Option<&'a FractureState>,
    /// Number of the first bond.
    pub(super) first: usize,
    pub(super) out: &'a mut [Carried],
}

impl OnLanes for Octets<'_> {
    #[inline(always)]
    fn on<L: Lanes>(self, l: L) {
        l.run(With(l, self));
    }
}

impl<L: Lanes> Job for With<L, Octets<'_>> {
    #[inline(always)]
    fn call(self) {
        let Self(l, pass) = self;
        let mut bonds = Octet::default();
        for (first, out) in (pass.first..).step_by(LANES).zip(pass.out.chunks_mut(LANES)) {
            let mut awake = [false; LANES];
            for (k, awake) in awake.iter_mut().enumerate().take(out.len()) {
                prefetch(l, pass.model, pass.reader, first + k + AHEAD);
                *awake = !pass.model.is_idle(pass.broken, first + k);
                if *awake {
                    bonds.set(k, pass.model, pass.reader, first + k);
                }
            }
            out.fill(Carried::NOTHING);
            if awake == [false; LANES] {
                continue;
            }
            let (loads, strains) = bonds.loads(l, &pass.reader.rigidity);
            let ratios = pass
                .strength
                .map_or([0.0; LANES], |f| f.ratios(l, first, &strains));
            for (k, out) in out.iter_mut().enumerate().filter(|e| awake[e.0]) {
                *out = Carried {
                    utilisation: ratios[k],
                    ..loads.carried(k)
                };
            }
        }
    }
}

/// Prefetches the state of the second particle of bond `b`; the first one is that of a bond before.
#[inline(always)]
fn prefetch<L: Lanes>(l: L, model: &DemModel, reader: &Reader<'_>, b: usize) {
    let Some([_, j]) = model.body.pairs().get(b).map(|p| p.map(|i| i as usize)) else {
        return;
    };
    let (x, q) = (model.body.positions(), reader.q);
    prefetch_lines(l, x.as_ptr().wrapping_add(j).cast::<f64>(), 8);
    prefetch_lines(l, q.as_ptr().wrapping_add(3 * j), 8);
    prefetch_lines(l, q.as_ptr().wrapping_add(q.len() / 2 + 3 * j), 8);
}

/// Eight bonds between the places and rotations of their particles.
#[derive(Default)]
struct Octet {
    /// Vectors from the first centres to the second at rest \[m\].
    rest: [Lane; 3],
    /// Displacements of the second particles relative to the first \[m\].
    shift: [Lane; 3],
    /// Rotations of the first and of the second particles \[rad\].
    turns: [[Lane; 3]; 2],
    /// Numerators and denominators of the scales without weights.
    scale: [Lane; 2],
}

impl Octet {
    /// Reads bond `b` into lane `k`.
    #[inline(always)]
    fn set(&mut self, k: usize, model: &DemModel, reader: &Reader<'_>, b: usize) {
        let [i, j] = model.body.pairs()[b].map(|i| i as usize);
        let span = model.body.span(b);
        let [first, second] = [reader.twist(i), reader.twist(j)];
        for c in 0..3 {
            self.rest[c][k] = span[c];
            self.shift[c][k] = second.linear[c] - first.linear[c];
            self.turns[0][c][k] = first.angular[c];
            self.turns[1][c][k] = second.angular[c];
        }
        let [above, below] = model.plain_scale(b);
        self.scale[0][k] = above;
        self.scale[1][k] = below;
    }

    /// Returns what the bonds carry, and their strains, by the formulas of [`crate::bond::LinearBond`].
    #[inline(always)]
    fn loads<L: Lanes>(&self, l: L, k: &BeamRigidity) -> (Loads, Strains<L>) {
        let times = |x: f64, v: L::V| l.mul(l.splat(x), v);
        let (span, du) = (load(l, &self.rest), load(l, &self.shift));
        let [ti, tj] = [load(l, &self.turns[0]), load(l, &self.turns[1])];
        let s = l.div(l.load(&self.scale[0]), l.load(&self.scale[1]));
        let length = l.sqrt(plain_dot(l, span, span));
        let p = over(l, span, l.mul(length, length));
        let q = plain_dot(l, p, p);
        let stretch = plain_dot(l, p, du);
        let chord = plain_cross(l, p, du);
        // Forces.
        let b = l.mul(times(2.0 * k.bending, s), q);
        let bent = scale(l, plain_cross(l, p, sum(l, ti, tj)), l.splat(3.0));
        let across = scale(l, sum(l, scale(l, du, times(6.0, q)), bent), b);
        let stiff = l.sub(l.splat(k.axial), times(12.0 * k.bending, q));
        let force = sum(l, across, scale(l, p, l.mul(l.mul(stiff, s), stretch)));
        // Energies.
        let twist = plain_dot(l, p, diff(l, tj, ti));
        let a = diff(l, diff(l, ti, scale(l, p, l.div(plain_dot(l, p, ti), q))), chord);
        let e = diff(l, diff(l, tj, scale(l, p, l.div(plain_dot(l, p, tj), q))), chord);
        let strains = Strains {
            length: l.recip(l.sqrt(q)),
            axial: stretch,
            twist,
            a,
            b: e,
        };
        let axial = l.mul(l.mul(times(0.5 * k.axial, s), stretch), stretch);
        let torsion = l.mul(l.mul(times(0.5 * k.torsion, s), twist), twist);
        let energy = l.add(l.add(axial, torsion), l.mul(b, strains.bend(l)));
        // Components, and the moment for the stress.
        let arm = over(l, p, q);
        let along = over(l, arm, l.sqrt(plain_dot(l, arm, arm)));
        let axial = plain_dot(l, along, force);
        let shear = diff(l, force, scale(l, along, axial));
        let product = |a: usize, b: usize| l.mul(arm[a], force[b]);
        let half = |a: usize, b: usize| times(0.5, l.add(product(a, b), product(b, a)));
        let loads = Loads {
            moment: [
                l.store(product(0, 0)),
                l.store(product(1, 1)),
                l.store(product(2, 2)),
                l.store(half(0, 1)),
                l.store(half(1, 2)),
                l.store(half(0, 2)),
            ],
            axial: l.store(axial),
            shear: l.store(l.sqrt(plain_dot(l, shear, shear))),
            energy: l.store(energy),
        };
        (loads, strains)
    }
}

/// Forces and energies of eight bonds.
struct Loads {
    moment: [Lane; 6],
    axial: Lane,
    shear: Lane,
    energy: Lane,
}

impl Loads {
    /// Returns what the bond of lane `k` carries, without its utilisation.
    #[inline(always)]
    fn carried(&self, k: usize) -> Carried {
        let m = &self.moment;
        Carried {
            moment: SymmetricTensor([m[0][k], m[1][k], m[2][k], m[3][k], m[4][k], m[5][k]]),
            axial: self.axial[k],
            shear: self.shear[k],
            energy: self.energy[k],
            utilisation: 0.0,
        }
    }
}

/// Loads three coordinates.
#[inline(always)]
fn load<L: Lanes>(l: L, x: &[Lane; 3]) -> Vec3<L> {
    [l.load(&x[0]), l.load(&x[1]), l.load(&x[2])]
}

/// `a/s`.
#[inline(always)]
fn over<L: Lanes>(l: L, a: Vec3<L>, s: L::V) -> Vec3<L> {
    [l.div(a[0], s), l.div(a[1], s), l.div(a[2], s)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bond::BeamMaterial;
    use crate::fracture::{Criterion, Fracture, locked};
    use crate::kernel::engine::Isa;
    use crate::packing::{Container, PackingSpec};
    use arlequin_core::{Model, Weight};
    use nalgebra::Point3;

    #[derive(Debug)]
    struct Falling;
    impl Weight<f64> for Falling {
        fn value(&self, x: &Point3<f64>) -> f64 {
            1.0 - (x.x / 4e-3).clamp(0.0, 1.0)
        }
    }

    #[test]
    fn eight_bonds_have_the_bits_of_each_on_its_own() -> arlequin_core::Result<()> {
        let packing = PackingSpec::quench(Container::cylinder(5e-3, 1e-3)?, 300, 3).build()?;
        let noise = |i: usize| ((i as f64 * 12.9898).sin() * 43_758.545_3).fract();
        for criterion in [
            Criterion::Axial,
            Criterion::Rankine,
            Criterion::Mises,
            Criterion::Energy,
            Criterion::TensileEnergy,
        ] {
            let model = DemModel::new("bar", &packing, BeamMaterial::SILICA, 2200.0)?;
            let mut model = model.with_watched_strength(Fracture::new(criterion, 20.0))?;
            model.set_internal_weight(&Falling)?;
            let n = model.nodes().len();
            let size = |i: usize| if i < 3 * n { 1e-7 } else { 1e-3 };
            let q: Vec<f64> = (0..6 * n).map(|i| noise(i) * size(i)).collect();
            let (reader, log, strength) = (model.reader(&q), locked(&model.log), model.watched.as_ref());
            // Not a multiple of eight, and not from the first bond on.
            let bonds = 3..model.body.pairs().len() / LANES * LANES;
            let alone = bonds.clone().map(|b| model.carried(b, &reader, strength));
            let alone: Vec<Carried> = alone.collect();
            let mut isas = vec![Isa::Portable, Isa::detect()];
            #[cfg(target_arch = "x86_64")]
            isas.extend(pulp::x86::V3::try_new().map(Isa::V3));
            for isa in isas {
                let mut together = vec![Carried::NOTHING; alone.len()];
                isa.run(Octets {
                    model: &model,
                    reader: &reader,
                    broken: &log,
                    strength,
                    first: bonds.start,
                    out: &mut together,
                });
                assert!(alone == together, "{criterion:?}, {}", isa.name());
            }
            assert!(alone.iter().all(|c| c.utilisation != 0.0 && c.energy > 0.0));
        }
        Ok(())
    }
}
