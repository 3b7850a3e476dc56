//! The block kernel in the numbering of a model: rows from the unknowns, forces into flat arrays.

use crate::bond::BeamRigidity;
use crate::error::{DemError, Result};
use crate::fracture::state::Incidence;
use crate::kernel::engine::{Isa, Marks, Pass, RotationVector, Sink};
use crate::kernel::lanes::{LANES, Lanes, Row, Vec3, axpy, cross, dot, scale};
use crate::kernel::law::{Finite, Linear};
use crate::kernel::layout::Layout;
use crate::kernel::screen::Screened;
use crate::particles::BondedParticles;
use rayon::prelude::*;
use std::sync::atomic::{AtomicBool, Ordering};

/// Particles above which a second thread pays for its wake-up.
const LARGE: usize = 4_000;

/// Particles per unit of parallel work.
const CHUNK: usize = 1_024;

/// Largest rotation of a particle (rad): at a full turn a rotation vector no longer tells how the
/// particle goes on turning.
pub(crate) const MAX_ROTATION: f64 = 6.0;

impl RotationVector for Linear {
    #[inline]
    fn write_rows(rows: &mut [Row<f64>], u: &[f64], th: &[f64]) {
        let Some((last, rows)) = rows.split_last_mut() else {
            return;
        };
        // Four numbers at a time: the fourth lands in a free place of the row.
        let sources = u.windows(4).step_by(3).zip(th.windows(4).step_by(3));
        for (row, (u, th)) in rows.iter_mut().zip(sources) {
            row.0[..4].copy_from_slice(u);
            row.0[4..].copy_from_slice(th);
        }
        last.0[..3].copy_from_slice(&u[u.len() - 3..]);
        last.0[4..7].copy_from_slice(&th[th.len() - 3..]);
    }
    #[inline(always)]
    fn generalised<L: Lanes<T = f64>>(_l: L, _own: &[L::V; 8], m: Vec3<L>) -> Vec3<L> {
        m
    }
}

/// `cos(a/2)` and `sin(a/2)/a` of a rotation by the angle `a`, `x = a^2`.
#[inline(always)]
fn half_angle(x: f64) -> (f64, f64) {
    if x < 0.25 {
        // y = (a/2)^2 <= 1/16: the sixth power is below the last bit. Constants, because ten divisions per particle
        // would cost as much as a bond.
        const COS: [f64; 6] = [
            1.0,
            -1.0 / 2.0,
            1.0 / 24.0,
            -1.0 / 720.0,
            1.0 / 40_320.0,
            -1.0 / 3_628_800.0,
        ];
        const SIN: [f64; 6] = [
            0.5,
            -0.5 / 6.0,
            0.5 / 120.0,
            -0.5 / 5_040.0,
            0.5 / 362_880.0,
            -0.5 / 39_916_800.0,
        ];
        let y = 0.25 * x;
        let series = |k: &[f64; 6]| k[0] + y * (k[1] + y * (k[2] + y * (k[3] + y * (k[4] + y * k[5]))));
        return (series(&COS), series(&SIN));
    }
    let a = x.sqrt();
    let (s, c) = (0.5 * a).sin_cos();
    (c, s / a)
}

/// The spin of a particle with rotation vector `th` is `T(th) dth/dt`, hence `-dU/dth = T^T m`:
///
/// ```text
/// T^T m = m - B th x m + C th x (th x m)    B = (1 - cos a)/a^2    C = (a - sin a)/a^3    a = |th|
/// ```
impl RotationVector for Finite {
    #[inline]
    fn write_rows(rows: &mut [Row<f64>], u: &[f64], th: &[f64]) {
        let sources = u.as_chunks::<3>().0.iter().zip(th.as_chunks::<3>().0);
        for (row, (u, th)) in rows.iter_mut().zip(sources) {
            let (c, s) = half_angle(th[0] * th[0] + th[1] * th[1] + th[2] * th[2]);
            *row = Row([u[0], u[1], u[2], c, s * th[0], s * th[1], s * th[2], s]);
        }
    }
    #[inline(always)]
    fn generalised<L: Lanes<T = f64>>(l: L, own: &[L::V; 8], m: Vec3<L>) -> Vec3<L> {
        let (c, s) = (own[3], own[7]);
        let th = scale(l, [own[4], own[5], own[6]], l.recip(s));
        // 1 - cos a = 2 sin^2(a/2), sin a = 2 sin(a/2) cos(a/2). C multiplies th twice: neither
        // its cancellation for small angles nor the shift of the divisor away from zero matters.
        let twice = l.add(s, s);
        let minus_b = l.nmadd(twice, s, l.splat(0.0));
        let x = l.add(dot(l, th, th), l.splat(1e-30));
        let e = l.mul(l.nmadd(twice, c, l.splat(1.0)), l.recip(x));
        let once = cross(l, th, m);
        axpy(l, cross(l, th, once), e, axpy(l, once, minus_b, m))
    }
}

/// One body, one law.
#[derive(Debug)]
pub(crate) struct Gather<W: RotationVector> {
    layout: Layout<f64, W>,
    rows: Vec<Row<f64>>,
    rigidity: BeamRigidity,
    isa: Isa,
}

impl<W: Screened> Gather<W> {
    /// `body` must be numbered for locality already.
    pub(crate) fn new(body: &BondedParticles) -> Self {
        let layout = Layout::ordered(body, (0..body.len() as u32).collect());
        let mut rows = vec![Row::default(); layout.inverse_mass.len() * LANES];
        let rest = vec![0.0; 3 * rows.len()];
        W::write_rows(&mut rows, &rest, &rest);
        Self {
            layout,
            rows,
            rigidity: *body.rigidity(),
            isa: Isa::detect(),
        }
    }

    /// Adds forces and torques to `f`; both in the layout of the model. With `marks` it looks at strengths on the way.
    pub(crate) fn add(
        &mut self,
        q: &[f64],
        f: &mut [f64],
        factors: Option<&[f64]>,
        marks: Option<Marks<'_>>,
    ) {
        let n = q.len() / 6;
        let parallel = n > LARGE && rayon::current_num_threads() > 1;
        if parallel {
            // One entry into the pool for both passes.
            rayon::scope(|_| self.passes(q, f, factors, marks, true));
        } else {
            self.passes(q, f, factors, marks, false);
        }
    }

    fn passes(
        &mut self,
        q: &[f64],
        f: &mut [f64],
        factors: Option<&[f64]>,
        marks: Option<Marks<'_>>,
        parallel: bool,
    ) {
        let n = q.len() / 6;
        let (u, th) = q.split_at(3 * n);
        if parallel {
            let sources = u.par_chunks(3 * CHUNK).zip(th.par_chunks(3 * CHUNK));
            let rows = self.rows[..n].par_chunks_mut(CHUNK);
            rows.zip(sources)
                .for_each(|(rows, (u, th))| W::write_rows(rows, u, th));
        } else {
            W::write_rows(&mut self.rows[..n], u, th);
        }
        let (linear, angular) = f.split_at_mut(3 * n);
        let sink = Sink {
            linear,
            angular,
            factors,
        };
        self.pass().add_forces(&self.rows, sink, marks, parallel);
    }

    fn pass(&self) -> Pass<'_, f64, W> {
        Pass {
            layout: &self.layout,
            rigidity: self.rigidity,
            isa: self.isa,
            loads: None,
            free: None,
        }
    }

    /// Writes the forces of single blocks again, at the positions of the last [`Self::add`].
    pub(crate) fn again(&self, blocks: &[usize], f: &mut [f64], factors: Option<&[f64]>) {
        let n = f.len() / 6;
        let (linear, angular) = f.split_at_mut(3 * n);
        for &b in blocks {
            let particles = b * LANES..n.min((b + 1) * LANES);
            let range = 3 * particles.start..3 * particles.end;
            let (linear, angular) = (&mut linear[range.clone()], &mut angular[range]);
            linear.fill(0.0);
            angular.fill(0.0);
            let sink = Sink {
                linear,
                angular,
                factors: factors.map(|f| &f[particles]),
            };
            self.pass().add_from(b, &self.rows, sink, None);
        }
    }

    /// Leaves the bonds of blocks out that are not `whole`.
    pub(crate) fn refresh(
        &mut self,
        blocks: &[usize],
        body: &BondedParticles,
        incidence: &Incidence,
        whole: &dyn Fn(usize) -> bool,
    ) {
        for &b in blocks {
            self.layout.refresh(b, body, |i| incidence.of(i), whole);
        }
    }

    pub(crate) fn isa_name(&self) -> &'static str {
        self.isa.name()
    }

    pub(crate) fn bond_bytes(&self) -> usize {
        self.layout.bond_bytes()
    }
}

/// Refuses rotation vectors near or beyond a full turn.
pub(crate) fn check_rotations(th: &[f64]) -> Result<()> {
    let over = |t: &[f64]| t[0] * t[0] + t[1] * t[1] + t[2] * t[2] > MAX_ROTATION * MAX_ROTATION;
    let found = AtomicBool::new(false);
    let look = |part: &[f64]| {
        if part.chunks_exact(3).any(over) {
            found.store(true, Ordering::Relaxed);
        }
    };
    if th.len() > 3 * LARGE && rayon::current_num_threads() > 1 {
        th.par_chunks(3 * CHUNK).for_each(look);
    } else {
        look(th);
    }
    if !found.into_inner() {
        return Ok(());
    }
    let particle = th.chunks_exact(3).position(over).unwrap_or_default();
    let t = &th[3 * particle..3 * particle + 3];
    Err(DemError::RotationTooLarge {
        particle,
        angle: (t[0] * t[0] + t[1] * t[1] + t[2] * t[2]).sqrt(),
        limit: MAX_ROTATION,
    })
}
