//! Three boxes of finite elements in a row; the middle one is fine beside the first and coarse beside the
//! last.

use super::solid::{block, material, mediator};
use arlequin::core::nalgebra::Point3;
use arlequin::core::{
    Coupled, InterfaceOptions, InterfaceSpec, Junction, OwnStep, Profile, Ramp, Result, Slab, Solver,
    Subdomain, TimeStep, Weights,
};
use arlequin::fem_ref::{ElementKind, FemModel};
use std::sync::Arc;

/// Numbers of own steps of the three models.
pub(crate) fn ratios(counts: [usize; 3]) -> [OwnStep<f64>; 3] {
    counts.map(OwnStep::Ratio)
}

#[derive(Debug, Clone)]
pub(crate) struct Chain {
    /// Beginning of the third box and of the second overlap. Both overlaps have unit length; the first lies
    /// from 2 to 3.
    pub(crate) third: f64,
    pub(crate) profile: Profile<f64>,
    pub(crate) epsilon: f64,
    pub(crate) own: [OwnStep<f64>; 3],
    pub(crate) solver: Solver<f64>,
    /// Refinement factor of all meshes.
    pub(crate) fine: usize,
    /// True if the first and the last model are tied as well, where all three overlap.
    pub(crate) closed: bool,
}

impl Default for Chain {
    fn default() -> Self {
        Self {
            third: 3.0,
            profile: Profile::Cubic,
            epsilon: 0.01,
            own: ratios([1; 3]),
            solver: Solver::Auto,
            fine: 1,
            closed: false,
        }
    }
}

impl Chain {
    pub(crate) fn models(&self) -> [FemModel<f64>; 3] {
        let (end, n) = (self.third + 1.0, self.fine);
        let build = |name: &str, kind, x: [f64; 2], per_length: f64, across: usize| {
            let along = ((x[1] - x[0]) * per_length).round() as usize;
            let mesh = block(kind, x, [n * along, n * across, n * across]);
            FemModel::new(name, mesh, material()).unwrap()
        };
        [
            build("left", ElementKind::Hex8, [0.0, 3.0], 2.0, 2),
            build("middle", ElementKind::Tet4, [2.0, end], 3.0, 3),
            build("right", ElementKind::Hex8, [self.third, 6.0], 5.0, 4),
        ]
    }

    /// Returns the weights `f`, `(1 − f) g`, `(1 − f)(1 − g)`.
    pub(crate) fn weights(&self) -> [Weights<f64>; 3] {
        let point = |x: f64| Point3::new(x, 0.0, 0.0);
        let ramp = |from: f64| {
            let slab = Slab::between(point(from + 1.0), point(from)).unwrap();
            Weights::from_weight(Arc::new(
                Ramp::new(Arc::new(slab), self.profile.clone(), self.epsilon).unwrap(),
            ))
        };
        let (f, g) = (ramp(2.0), ramp(self.third));
        let [beside_f, beside_g] = [&f, &g].map(|w| Weights::complement_of(std::slice::from_ref(w)));
        [f, g.within(&beside_f), beside_g.within(&beside_f)]
    }

    /// Returns the three models in random motion.
    pub(crate) fn bodies(&self) -> Vec<Subdomain<f64>> {
        let mut next = arlequin_studies::noise(21);
        let parts = self.models().into_iter().zip(self.weights()).zip(self.own);
        parts
            .map(|((model, w), own_step)| {
                let s = Subdomain::fine(model, w).with_step(own_step);
                let n = s.model().layout().dofs();
                s.with_initial(vec![0.0; n], (0..n).map(|_| next()).collect())
                    .unwrap()
            })
            .collect()
    }

    pub(crate) fn interfaces(
        &self,
        junction: &dyn Fn() -> Box<dyn Junction<f64>>,
    ) -> Vec<InterfaceSpec<f64>> {
        let tie = |name: &str, coarse, fine, from: f64| InterfaceSpec {
            name: name.into(),
            coarse,
            fine,
            mediator: mediator(ElementKind::Hex8, [from, from + 1.0], [2 * self.fine; 3]),
            junction: junction(),
            options: InterfaceOptions {
                solver: self.solver,
                ..InterfaceOptions::default()
            },
        };
        let mut out = vec![tie("west", 0, 1, 2.0), tie("east", 1, 2, self.third)];
        if self.closed {
            out.push(tie("across", 0, 2, self.third));
        }
        out
    }

    pub(crate) fn run(&self, junction: &dyn Fn() -> Box<dyn Junction<f64>>) -> Result<Coupled<f64>> {
        Coupled::new(
            self.bodies(),
            self.interfaces(junction),
            TimeStep::Fraction(0.8),
            None,
        )
    }
}
