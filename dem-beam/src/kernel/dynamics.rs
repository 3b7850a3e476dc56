//! The particles in motion: velocity Verlet over the block kernel.
//!
//! ```text
//! v_{n+1/2} = v_n + dt/2 a_n    q_{n+1} = q_n (+) dt v_{n+1/2}    v_{n+1} = v_{n+1/2} + dt/2 a_{n+1}
//! ```
//!
//! Consecutive half kicks are merged, so `run(n)` evaluates forces `n + 1` times. Rotations are
//! moved by the same rule; under the finite-rotation law `(+)` is a rotation of the quaternion.

use super::engine::{Dispatch, Isa, Pass, Six};
use super::lanes::{LANES, Row, Scalar};
use super::law::{Finite, Law, Linear};
use super::layout::Layout;
use crate::bond::{BeamRigidity, Twist};
use crate::error::{Result, finite, positive};
use crate::finite;
use crate::particles::{BondedParticles, expect_len};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

/// Which components of a particle's motion are held at their present velocity.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Held {
    /// Translations along x, y, z.
    pub linear: [bool; 3],
    /// Rotations about x, y, z.
    pub angular: [bool; 3],
}

impl Held {
    /// All six.
    pub const ALL: Self = Self {
        linear: [true; 3],
        angular: [true; 3],
    };
}

#[derive(Debug)]
struct State<T: Scalar, W: Law<T>> {
    layout: Layout<T, W>,
    rows: Vec<Row<T>>,
    spare: Vec<Row<T>>,
    velocity: Vec<Six<T>>,
    force: Vec<Six<T>>,
    loads: Option<Vec<Six<T>>>,
    free: Option<Vec<Six<T>>>,
    rigidity: BeamRigidity,
    isa: Isa,
}

#[derive(Debug)]
enum Inner<T: Dispatch> {
    Linear(State<T, Linear>),
    Finite(State<T, Finite>),
}

/// A body in motion. `T` is the scalar of the kernel, f64 or f32; the interface speaks f64.
///
/// Particles are numbered as in the [`BondedParticles`] it was made from.
#[derive(Debug)]
#[allow(private_bounds, reason = "the bound only selects f64 and f32")]
pub struct BeamDynamics<T: Dispatch = f64> {
    inner: Inner<T>,
    body: BondedParticles,
    step: f64,
}

macro_rules! each_law {
    ($self:expr, $s:ident => $e:expr) => {
        match $self {
            Inner::Linear($s) => $e,
            Inner::Finite($s) => $e,
        }
    };
}

#[allow(private_bounds, reason = "the bound only selects f64 and f32")]
impl<T: Dispatch> BeamDynamics<T> {
    /// Small-rotation law, at rest. `step` is the time step (s); it is not checked here against
    /// the critical one, see [`crate::critical`].
    ///
    /// # Errors
    /// [`crate::DemError::OutOfRange`] unless `step` is positive.
    pub fn linear(body: &BondedParticles, step: f64) -> Result<Self> {
        positive("time step", step)?;
        let inner = Inner::Linear(State::new(body));
        Ok(Self {
            inner,
            body: body.clone(),
            step,
        })
    }

    /// Finite-rotation law, at rest.
    ///
    /// # Errors
    /// As [`Self::linear`].
    pub fn finite(body: &BondedParticles, step: f64) -> Result<Self> {
        positive("time step", step)?;
        let mut state = State::<T, Finite>::new(body);
        state.rows.iter_mut().for_each(|r| r.0[3] = T::of(1.0));
        state.spare.clone_from(&state.rows);
        let inner = Inner::Finite(state);
        Ok(Self {
            inner,
            body: body.clone(),
            step,
        })
    }

    /// The body.
    #[must_use]
    pub fn body(&self) -> &BondedParticles {
        &self.body
    }

    /// Time step (s).
    #[must_use]
    pub fn step(&self) -> f64 {
        self.step
    }

    /// Name of the instruction set in use.
    #[must_use]
    pub fn instruction_set(&self) -> &'static str {
        each_law!(&self.inner, s => s.isa.name())
    }

    /// Uses plain arrays instead of the SIMD instructions found: the reference for tests.
    pub fn force_portable(&mut self) {
        each_law!(&mut self.inner, s => s.isa = Isa::Portable);
    }

    /// Bytes of bond data per bond, both directions and empty lanes included.
    #[must_use]
    pub fn bytes_per_bond(&self) -> f64 {
        let bytes = each_law!(&self.inner, s => s.layout.bond_bytes());
        bytes as f64 / self.body.pairs().len().max(1) as f64
    }

    /// Bytes a step reads and writes at least, per bond: bond data, rows in and out, velocities in
    /// and out, masses. Neighbours' rows count once; lines read in order to be written do not count.
    #[must_use]
    pub fn traffic_per_bond(&self) -> f64 {
        let bytes = each_law!(&self.inner, s => s.layout.bond_bytes() + s.layout.particle_bytes());
        bytes as f64 / self.body.pairs().len().max(1) as f64
    }

    /// Share of the kernel's lanes that hold a bond; the others idle.
    #[must_use]
    pub fn lane_fill(&self) -> f64 {
        let slots = each_law!(&self.inner, s => s.layout.slots.len());
        2.0 * self.body.pairs().len() as f64 / (slots.max(1) * LANES) as f64
    }

    /// External force and torque on each particle, constant until set again.
    ///
    /// # Errors
    /// [`crate::DemError::LengthMismatch`], [`crate::DemError::NotFinite`].
    pub fn set_loads(&mut self, loads: &[Twist]) -> Result<()> {
        check_twists("load", loads, self.body.len())?;
        each_law!(&mut self.inner, s => {
            let mut out = s.loads.take().unwrap_or_else(|| s.blank());
            s.scatter(loads, &mut out);
            s.loads = Some(out);
        });
        Ok(())
    }

    /// Supports: held components keep their velocity (zero for a clamp) whatever the forces.
    ///
    /// # Errors
    /// [`crate::DemError::LengthMismatch`].
    pub fn set_held(&mut self, held: &[Held]) -> Result<()> {
        expect_len("supports", held.len(), self.body.len())?;
        let one = |h: bool| if h { 0.0 } else { 1.0 };
        let free: Vec<Twist> = held
            .iter()
            .map(|h| Twist {
                linear: Vector3::from(h.linear.map(one)),
                angular: Vector3::from(h.angular.map(one)),
            })
            .collect();
        each_law!(&mut self.inner, s => {
            let mut out = s.free.take().unwrap_or_else(|| s.blank());
            s.scatter(&free, &mut out);
            s.free = Some(out);
        });
        Ok(())
    }

    /// Displacements (m) and rotation vectors (rad).
    ///
    /// # Errors
    /// [`crate::DemError::LengthMismatch`], [`crate::DemError::NotFinite`].
    pub fn set_displacements(&mut self, state: &[Twist]) -> Result<()> {
        check_twists("displacement", state, self.body.len())?;
        match &mut self.inner {
            Inner::Linear(s) => s.write_rows(state, |a| [0.0, a.x, a.y, a.z, 0.0]),
            Inner::Finite(s) => s.write_rows(state, |a| {
                let q = UnitQuaternion::from_scaled_axis(*a);
                [q.w, q.i, q.j, q.k, 0.0]
            }),
        }
        Ok(())
    }

    /// Velocities (m/s) and angular velocities (rad/s).
    ///
    /// # Errors
    /// [`crate::DemError::LengthMismatch`], [`crate::DemError::NotFinite`].
    pub fn set_velocities(&mut self, velocity: &[Twist]) -> Result<()> {
        check_twists("velocity", velocity, self.body.len())?;
        each_law!(&mut self.inner, s => {
            let mut out = std::mem::take(&mut s.velocity);
            s.scatter(velocity, &mut out);
            s.velocity = out;
        });
        Ok(())
    }

    /// Displacements (m) and rotation vectors (rad; of norm <= pi under the finite law).
    #[must_use]
    pub fn displacements(&self) -> Vec<Twist> {
        let at = |r: &Row<T>, k: usize| r.0[k].to_f64();
        let linear = |r: &Row<T>| Vector3::new(at(r, 0), at(r, 1), at(r, 2));
        match &self.inner {
            Inner::Linear(s) => s.read_rows(|r| Twist {
                linear: linear(r),
                angular: Vector3::new(at(r, 4), at(r, 5), at(r, 6)),
            }),
            Inner::Finite(s) => s.read_rows(|r| {
                let q = Quaternion::new(at(r, 3), at(r, 4), at(r, 5), at(r, 6));
                let angular = UnitQuaternion::new_unchecked(q).scaled_axis();
                Twist {
                    linear: linear(r),
                    angular,
                }
            }),
        }
    }

    /// Velocities (m/s) and angular velocities (rad/s).
    #[must_use]
    pub fn velocities(&self) -> Vec<Twist> {
        each_law!(&self.inner, s => s.collect(&s.velocity))
    }

    /// Internal forces (N) and torques (N m) on the particles in the present state.
    pub fn forces(&mut self) -> Vec<Twist> {
        each_law!(&mut self.inner, s => {
            s.refresh_forces();
            s.collect(&s.force)
        })
    }

    /// Advances by `steps` steps. Allocates nothing.
    pub fn run(&mut self, steps: usize) {
        let dt = self.step;
        // One entry into the pool for all steps: entering per step costs an allocation now and
        // then, and a wake-up each time.
        rayon::scope(|_| each_law!(&mut self.inner, s => s.run(steps, dt)));
    }

    /// Kinetic energy (J).
    #[must_use]
    pub fn kinetic_energy(&self) -> f64 {
        let half = |m: f64, v: &Vector3<f64>| 0.5 * m * v.dot(v);
        self.velocities()
            .iter()
            .zip(self.body.mass().iter().zip(self.body.inertia()))
            .map(|(v, (&m, &i))| half(m, &v.linear) + half(i, &v.angular))
            .sum()
    }

    /// Elastic energy (J).
    #[must_use]
    pub fn elastic_energy(&self) -> f64 {
        let ends = self.body.bonds().iter().zip(self.body.pairs());
        match &self.inner {
            Inner::Linear(_) => {
                let x = self.displacements();
                let k = self.body.rigidity();
                ends.map(|(b, &[i, j])| b.energy(k, &x[i as usize], &x[j as usize]))
                    .sum()
            }
            Inner::Finite(s) => {
                let x = s.read_rows(|r| finite::Pose {
                    displacement: Vector3::new(r.0[0].to_f64(), r.0[1].to_f64(), r.0[2].to_f64()),
                    rotation: UnitQuaternion::new_unchecked(Quaternion::new(
                        r.0[3].to_f64(),
                        r.0[4].to_f64(),
                        r.0[5].to_f64(),
                        r.0[6].to_f64(),
                    )),
                });
                let k = self.body.rigidity();
                ends.map(|(b, &[i, j])| finite::energy(b, k, &x[i as usize], &x[j as usize]))
                    .sum()
            }
        }
    }

    /// The quantity velocity Verlet conserves exactly for the linear law without loads:
    /// `H = 1/2 v' M v' + 1/2 q_n K q_{n+1}`, `v' = v_{n+1/2}`, which is
    /// `1/2 v_n M v_n + 1/2 q_n K q_n - dt^2/8 a_n M a_n` (J). Held components are left out of
    /// the accelerations.
    pub fn invariant(&mut self) -> f64 {
        let forces = self.forces();
        let held: Option<Vec<Twist>> = each_law!(&self.inner, s => s.free.as_ref().map(|f| s.collect(f)));
        let mut correction = 0.0;
        for (p, f) in forces.iter().enumerate() {
            let free = held.as_ref().map_or(
                Twist {
                    linear: Vector3::repeat(1.0),
                    angular: Vector3::repeat(1.0),
                },
                |h| h[p],
            );
            let (a, b) = (
                f.linear.component_mul(&free.linear),
                f.angular.component_mul(&free.angular),
            );
            let (m, i) = (self.body.mass()[p], self.body.inertia()[p]);
            if m > 0.0 {
                correction += a.norm_squared() / m + b.norm_squared() / i;
            }
        }
        self.kinetic_energy() + self.elastic_energy() - self.step * self.step / 8.0 * correction
    }
}

fn check_twists(what: &'static str, x: &[Twist], count: usize) -> Result<()> {
    expect_len(what, x.len(), count)?;
    for (i, t) in x.iter().enumerate() {
        for c in t.linear.iter().chain(t.angular.iter()) {
            finite(what, "particle", i, *c)?;
        }
    }
    Ok(())
}

impl<T: Dispatch, W: Law<T>> State<T, W> {
    fn new(body: &BondedParticles) -> Self {
        let layout = Layout::new(body);
        let blocks = layout.inverse_mass.len();
        let zero = [Row::default(); 6];
        Self {
            rows: vec![Row::default(); blocks * LANES],
            spare: vec![Row::default(); blocks * LANES],
            velocity: vec![zero; blocks],
            force: vec![zero; blocks],
            loads: None,
            free: None,
            rigidity: *body.rigidity(),
            isa: Isa::detect(),
            layout,
        }
    }

    fn blank(&self) -> Vec<Six<T>> {
        vec![[Row::default(); 6]; self.velocity.len()]
    }

    fn run(&mut self, steps: usize, dt: f64) {
        for n in 0..=steps {
            let kick = if steps == 0 {
                0.0
            } else if n == 0 || n == steps {
                0.5 * dt
            } else {
                dt
            };
            let drift = if n < steps { dt } else { 0.0 };
            let pass = Pass {
                layout: &self.layout,
                rigidity: self.rigidity,
                isa: self.isa,
                loads: self.loads.as_deref(),
                free: self.free.as_deref(),
            };
            pass.step(&self.rows, &mut self.spare, &mut self.velocity, [kick, drift]);
            std::mem::swap(&mut self.rows, &mut self.spare);
        }
    }

    fn refresh_forces(&mut self) {
        let pass = Pass {
            layout: &self.layout,
            rigidity: self.rigidity,
            isa: self.isa,
            loads: None,
            free: None,
        };
        pass.forces(&self.rows, &mut self.force);
    }

    fn scatter(&self, from: &[Twist], to: &mut [Six<T>]) {
        for (k, &i) in self.layout.order.iter().enumerate() {
            let t = &from[i as usize];
            for c in 0..3 {
                to[k / LANES][c].0[k % LANES] = T::of(t.linear[c]);
                to[k / LANES][c + 3].0[k % LANES] = T::of(t.angular[c]);
            }
        }
    }

    fn collect(&self, from: &[Six<T>]) -> Vec<Twist> {
        let mut out = vec![Twist::zero(); self.layout.order.len()];
        for (k, &i) in self.layout.order.iter().enumerate() {
            let at = |c: usize| from[k / LANES][c].0[k % LANES].to_f64();
            out[i as usize] = Twist {
                linear: Vector3::new(at(0), at(1), at(2)),
                angular: Vector3::new(at(3), at(4), at(5)),
            };
        }
        out
    }

    fn write_rows(&mut self, from: &[Twist], rotation: impl Fn(&Vector3<f64>) -> [f64; 5]) {
        for (k, &i) in self.layout.order.iter().enumerate() {
            let (u, r) = (from[i as usize].linear, rotation(&from[i as usize].angular));
            let row = [u.x, u.y, u.z, r[0], r[1], r[2], r[3], r[4]];
            self.rows[k].0 = row.map(T::of);
        }
    }

    fn read_rows<R: Clone>(&self, read: impl Fn(&Row<T>) -> R) -> Vec<R> {
        let mut out = vec![read(&self.rows[0]); self.layout.order.len()];
        for (k, &i) in self.layout.order.iter().enumerate() {
            out[i as usize] = read(&self.rows[k]);
        }
        out
    }
}
