//! What the state of a subdomain amounts to: energy, its field at a point.

use crate::{Real, Result, Subdomain, parallel};

impl<T: Real> Subdomain<T> {
    /// Invariant of the step just made: `½ v₊ᵀMv₊ + ½(U_n + U_{n+1}) + ¼ Δqᵀ(f_{n+1} − f_n)`, `v₊ = Δq/Δt`. For a
    /// linear model this is `½ v₊ᵀMv₊ + ½ q_nᵀKq_{n+1}`. Needs the displacements kept by [`Self::predict`].
    pub(crate) fn invariant(&mut self, dt: T) -> T {
        let (half, quarter) = (T::of(0.5), T::of(0.25));
        self.drawn_energy = self.model().internal_energy(&self.state.q);
        let potential = half * (self.model().internal_energy(&self.q_before) + self.drawn_energy);
        let (q, before, inertia) = (&self.state.q, &self.q_before, &self.inertia);
        let (force, force_before) = (&self.internal, &self.internal_before);
        let part = |range: std::ops::Range<usize>| {
            range.fold(T::zero(), |sum, i| {
                let dq = q[i] - before[i];
                let v = dq / dt;
                sum + (half * inertia[i] * v * v + quarter * dq * (force[i] - force_before[i]))
            })
        };
        potential + parallel::sum(q.len(), &part)
    }

    /// Internal energy at the whole step \[J\].
    pub fn internal_energy(&self) -> T {
        self.model().internal_energy(&self.state.q)
    }

    /// Kinetic energy at the whole step \[J\].
    pub fn kinetic_energy(&self) -> T {
        let (m, v) = (&self.inertia, &self.state.v);
        let part = |range: std::ops::Range<usize>| range.fold(T::zero(), |s, i| s + m[i] * v[i] * v[i]);
        T::of(0.5) * parallel::sum(v.len(), &part)
    }

    /// Displacement and velocity of the field at a point \[m, m/s\].
    ///
    /// # Errors
    /// [`crate::Error::OutsideDomain`].
    pub fn sample(&self, x: &nalgebra::Point3<T>) -> Result<[nalgebra::Vector3<T>; 2]> {
        let mut row = crate::field::ShapeRow::default();
        self.field().shape_at(x, false, &mut row)?;
        let d = self.model().layout().components;
        let mut out = [nalgebra::Vector3::zeros(); 2];
        for (sum, values) in out.iter_mut().zip([&self.state.q, &self.state.v]) {
            for (&k, &n) in row.nodes.iter().zip(&row.values) {
                sum.iter_mut()
                    .zip(&values[k * d..(k + 1) * d])
                    .for_each(|(s, v)| *s += n * *v);
            }
        }
        Ok(out)
    }
}
