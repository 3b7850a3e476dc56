//! Rigid motions that restore the momenta of bodies after their masses have changed hands.
//!
//! With the six unit motions `φ` of the free unknowns of a body (three translations, three rotations about
//! its centre), the correction `δv = Σ c_a φ_a` follows from the missing momenta `p`:
//!
//! ```text
//! Σ_b (φ_aᵀ M φ_b) c_b = p_a
//! ```

use super::Coupled;
use crate::coupled::momentum::{joined, momenta};
use crate::model::Arms;
use crate::{Real, Subdomain};
use nalgebra::{Matrix6, Vector3, Vector6};

/// Resistance to a unit motion, relative to the largest, below which there is none: a body on a line.
const FREE: f64 = 1e-12;

/// Calls `visit` with each free unknown, its mass and what the six unit motions are there.
fn for_each_free<T: Real>(
    s: &Subdomain<T>,
    (arms, centre): (Arms, &Vector3<T>),
    visit: &mut dyn FnMut(usize, T, &Vector6<T>),
) {
    let layout = s.model().layout();
    let (d, first) = (layout.components, layout.translations());
    let (m, free, q) = (s.inertia(), s.inverse_inertia(), &s.state().q);
    for (node, x) in s.model().nodes().iter().enumerate() {
        let mut arm = x.coords - centre;
        // With the arms of the ledger, or the momenta restored would not be those that it reports.
        if arms == Arms::Current {
            (0..d).for_each(|c| arm[c] += q[node * d + c]);
        }
        for c in 0..d {
            let k = node * d + c;
            // (ω × y)_c = ω · (y × e_c)
            let turn = arm.cross(&Vector3::ith(c, T::one()));
            let mut motion = Vector6::zeros();
            motion[c] = T::one();
            motion.fixed_rows_mut::<3>(3).copy_from(&turn);
            // Held and driven unknowns keep the velocities of their supports.
            if free[k] > T::zero() {
                visit(k, m[k], &motion);
            }
        }
        for c in 0..layout.rotations {
            let k = first + node * layout.rotations + c;
            if free[k] > T::zero() {
                visit(k, m[k], &Vector6::ith(3 + c, T::one()));
            }
        }
    }
}

/// Subdomains that interfaces join, with the arms and the centre of their body.
pub(super) struct Group<T> {
    members: Vec<usize>,
    arms: Arms,
    centre: Vector3<T>,
}

impl<T: Real> Coupled<T> {
    /// Groups of subdomains that interfaces join. Of a body whose parts only touch each other, each part
    /// keeps its own momenta in a change of weights.
    pub(super) fn joined_groups(&self) -> Vec<Group<T>> {
        let mut out = Vec::new();
        for (members, arms, centre) in self.ledger.bodies.iter().map(|b| b.frame()) {
            let groups = joined(&members, self.interfaces.iter().map(|i| i.sides));
            out.extend(groups.into_iter().map(|members| Group {
                members,
                arms,
                centre,
            }));
        }
        out
    }

    /// Linear and angular momentum of each group about the centre.
    pub(super) fn momenta_of_groups(&self, groups: &[Group<T>]) -> Vec<[Vector3<T>; 2]> {
        let of_group = |g: &Group<T>| momenta(&self.subdomains, &g.members, g.arms, &g.centre);
        groups.iter().map(of_group).collect()
    }

    /// Gives every group the rigid motion that restores its `momenta`; returns velocity and spin of each.
    pub(super) fn restore_momenta(
        &mut self,
        groups: &[Group<T>],
        momenta: &[[Vector3<T>; 2]],
    ) -> Vec<[Vector3<T>; 2]> {
        let mut motions = Vec::new();
        let present = self.momenta_of_groups(groups);
        for (
            Group {
                members,
                arms,
                centre,
            },
            (target, now),
        ) in groups.iter().zip(momenta.iter().zip(present))
        {
            let frame = (*arms, centre);
            let mut inertia = Matrix6::zeros();
            for k in members {
                for_each_free(&self.subdomains[*k], frame, &mut |_, m, motion| {
                    inertia += *motion * motion.transpose() * m;
                });
            }
            let [linear, angular] = [0, 1].map(|k| target[k] - now[k]);
            let mut missing = Vector6::zeros();
            missing.fixed_rows_mut::<3>(0).copy_from(&linear);
            missing.fixed_rows_mut::<3>(3).copy_from(&angular);
            let motion = solve(&inertia, &missing);
            for k in members {
                let mut change = Vec::new();
                for_each_free(&self.subdomains[*k], frame, &mut |i, _, unit| {
                    change.push((i, unit.dot(&motion)));
                });
                let v = self.subdomains[*k].velocities();
                change.into_iter().for_each(|(i, dv)| v[i] += dv);
            }
            motions.push([0, 3].map(|k| motion.fixed_rows::<3>(k).into_owned()));
        }
        motions
    }
}

/// Solves for the rigid motion; zero along motions that the body cannot make.
fn solve<T: Real>(inertia: &Matrix6<T>, missing: &Vector6<T>) -> Vector6<T> {
    // Arms have a unit: scaled to a unit diagonal, translations and rotations compare.
    let scale = inertia.diagonal().map(|d| {
        if d > T::zero() {
            T::one() / d.sqrt()
        } else {
            T::zero()
        }
    });
    let eigen = Matrix6::from_fn(|i, j| inertia[(i, j)] * scale[i] * scale[j]).symmetric_eigen();
    let load = missing.component_mul(&scale);
    let least = eigen.eigenvalues.amax() * T::of(FREE).max(T::epsilon() * T::of(16.0));
    let mut out = Vector6::zeros();
    for (value, mode) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
        // Motions without inertia among the free unknowns, such as the spin of a line about itself or what
        // supports hold, stay zero.
        if *value > least {
            out += mode * (mode.dot(&load) / *value);
        }
    }
    out.component_mul(&scale)
}
