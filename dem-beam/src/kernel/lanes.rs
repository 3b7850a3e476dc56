//! Eight lanes of arithmetic, for the instruction set found at run time.
//!
//! `Lanes` is the small part of SIMD that the kernels need: element-wise arithmetic, and the transposition of
//! eight rows of eight numbers into eight vectors in registers, which is faster than gather instructions. One
//! particle row is one cache line.
//!
//! Fused multiply-add is used where the processor has it: results may differ in the last bit between
//! instruction sets, never between thread counts.

#[cfg(target_arch = "x86_64")]
pub(crate) use super::lanes_x86::{Wide256, Wide512};

/// Array of `$e` for `$k` = 0 to 7, written out. Closures and `map` are compiled on their own, without the
/// instruction set of the caller, and cost a factor of three.
macro_rules! eight {
    ($k:ident => $e:expr) => {
        eight!(@ $k $e, 0 1 2 3 4 5 6 7)
    };
    (@ $k:ident $e:expr, $($n:literal)*) => {
        [$({
            let $k: usize = $n;
            $e
        }),*]
    };
}
pub(crate) use eight;

/// Implements element-wise methods of [`Lanes`], one per line: `name(s, a, b) => value;` with the lanes `s`.
macro_rules! elementwise {
    ($($name:ident($s:ident, $($x:ident),*) => $e:expr;)*) => {
        $(
            #[inline(always)]
            fn $name(self, $($x: Self::V),*) -> Self::V {
                let $s = self;
                $e
            }
        )*
    };
}
pub(crate) use elementwise;

/// Lanes per vector, particles per block.
pub(crate) const LANES: usize = 8;

/// Eight numbers, aligned to a cache line.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[repr(C, align(64))]
pub(crate) struct CacheLine(pub(crate) [f64; LANES]);

/// Element-wise arithmetic on eight lanes. A value proves that the processor has the instruction set.
pub(crate) trait Lanes: Copy + Send + Sync {
    type V: Copy;

    /// Runs `job` compiled for this instruction set.
    fn run<J: Job>(self, job: J);
    fn splat(self, x: f64) -> Self::V;
    fn load(self, x: &[f64; LANES]) -> Self::V;
    /// Converts eight integers, exactly.
    fn load_i32(self, x: &[i32; LANES]) -> Self::V;
    /// Converts eight numbers of single precision, exactly.
    fn load_f32(self, x: &[f32; LANES]) -> Self::V;
    fn store(self, x: Self::V) -> [f64; LANES];
    fn add(self, a: Self::V, b: Self::V) -> Self::V;
    fn sub(self, a: Self::V, b: Self::V) -> Self::V;
    fn mul(self, a: Self::V, b: Self::V) -> Self::V;
    /// `a/b`, rounded once.
    fn div(self, a: Self::V, b: Self::V) -> Self::V;
    /// `1/a`, to a few units in the last place.
    fn recip(self, a: Self::V) -> Self::V;
    /// `sqrt(a)`.
    fn sqrt(self, a: Self::V) -> Self::V;
    /// `a b + c`.
    fn madd(self, a: Self::V, b: Self::V, c: Self::V) -> Self::V;
    /// `c - a b`.
    fn nmadd(self, a: Self::V, b: Self::V, c: Self::V) -> Self::V;
    /// `a` where `a > b`, else `b`; also `b` where `a` is not a number.
    fn max(self, a: Self::V, b: Self::V) -> Self::V;
    /// Transposes: vector k holds entry k of the eight rows.
    fn transpose(self, rows: [[f64; LANES]; LANES]) -> [Self::V; LANES];
    /// Transposes back: cache line `k` holds lane k of the eight vectors.
    fn untranspose(self, v: [Self::V; LANES]) -> [[f64; LANES]; LANES];
    /// Interleaves three vectors to `x0 y0 z0 x1 y1 ...`.
    #[inline(always)]
    fn interleave(self, v: Vec3<Self>) -> [Self::V; 3] {
        // Through memory, for lanes without a permutation of two registers.
        let [x, y, z] = [self.store(v[0]), self.store(v[1]), self.store(v[2])];
        [
            self.load(&[x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2]]),
            self.load(&[z[2], x[3], y[3], z[3], x[4], y[4], z[4], x[5]]),
            self.load(&[y[5], z[5], x[6], y[6], z[6], x[7], y[7], z[7]]),
        ]
    }
    /// Prefetches a row. The address need not be valid.
    fn prefetch(self, row: *const CacheLine);
}

/// Work for [`Lanes::run`]. Implementations must be `#[inline(always)]` to be compiled for its instruction
/// set.
pub(crate) trait Job {
    fn call(self);
}

/// Plain arrays: work on every target and are the reference for the other lanes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Portable;

impl Lanes for Portable {
    type V = [f64; LANES];
    #[inline(always)]
    fn run<J: Job>(self, job: J) {
        job.call();
    }
    #[inline(always)]
    fn splat(self, x: f64) -> Self::V {
        [x; LANES]
    }
    #[inline(always)]
    fn load(self, x: &[f64; LANES]) -> Self::V {
        *x
    }
    #[inline(always)]
    fn load_i32(self, x: &[i32; LANES]) -> Self::V {
        eight!(k => f64::from(x[k]))
    }
    #[inline(always)]
    fn load_f32(self, x: &[f32; LANES]) -> Self::V {
        eight!(k => f64::from(x[k]))
    }
    #[inline(always)]
    fn store(self, x: Self::V) -> [f64; LANES] {
        x
    }
    elementwise! {
        add(_s, a, b) => eight!(k => a[k] + b[k]);
        sub(_s, a, b) => eight!(k => a[k] - b[k]);
        mul(_s, a, b) => eight!(k => a[k] * b[k]);
        div(_s, a, b) => eight!(k => a[k] / b[k]);
        recip(_s, a) => eight!(k => a[k].recip());
        sqrt(_s, a) => eight!(k => a[k].sqrt());
        // Not `mul_add`: on a processor without the instruction it is a library call, ten times slower.
        madd(_s, a, b, c) => eight!(k => a[k] * b[k] + c[k]);
        nmadd(_s, a, b, c) => eight!(k => c[k] - a[k] * b[k]);
        max(_s, a, b) => eight!(k => if a[k] > b[k] { a[k] } else { b[k] });
    }
    #[inline(always)]
    fn transpose(self, rows: [[f64; LANES]; LANES]) -> [Self::V; LANES] {
        eight!(c => eight!(r => rows[r][c]))
    }
    #[inline(always)]
    fn untranspose(self, v: [Self::V; LANES]) -> [[f64; LANES]; LANES] {
        eight!(r => eight!(c => v[c][r]))
    }
    #[inline(always)]
    fn prefetch(self, _row: *const CacheLine) {}
}

/// Three coordinates of eight lanes each.
pub(crate) type Vec3<L> = [<L as Lanes>::V; 3];

/// Dot product.
#[inline(always)]
pub(crate) fn dot<L: Lanes>(l: L, a: Vec3<L>, b: Vec3<L>) -> L::V {
    l.madd(a[2], b[2], l.madd(a[1], b[1], l.mul(a[0], b[0])))
}

/// Dot product without fused arithmetic: the bits of one lane are those of numbers.
#[inline(always)]
pub(crate) fn plain_dot<L: Lanes>(l: L, a: Vec3<L>, b: Vec3<L>) -> L::V {
    l.add(l.add(l.mul(a[0], b[0]), l.mul(a[1], b[1])), l.mul(a[2], b[2]))
}

/// Cross product without fused arithmetic, like [`plain_dot`].
#[inline(always)]
pub(crate) fn plain_cross<L: Lanes>(l: L, a: Vec3<L>, b: Vec3<L>) -> Vec3<L> {
    [
        l.sub(l.mul(a[1], b[2]), l.mul(a[2], b[1])),
        l.sub(l.mul(a[2], b[0]), l.mul(a[0], b[2])),
        l.sub(l.mul(a[0], b[1]), l.mul(a[1], b[0])),
    ]
}

/// Cross product.
#[inline(always)]
pub(crate) fn cross<L: Lanes>(l: L, a: Vec3<L>, b: Vec3<L>) -> Vec3<L> {
    [
        l.nmadd(a[2], b[1], l.mul(a[1], b[2])),
        l.nmadd(a[0], b[2], l.mul(a[2], b[0])),
        l.nmadd(a[1], b[0], l.mul(a[0], b[1])),
    ]
}

/// `a s + c`.
#[inline(always)]
pub(crate) fn axpy<L: Lanes>(l: L, a: Vec3<L>, s: L::V, c: Vec3<L>) -> Vec3<L> {
    [
        l.madd(a[0], s, c[0]),
        l.madd(a[1], s, c[1]),
        l.madd(a[2], s, c[2]),
    ]
}

/// `c - a s`.
#[inline(always)]
pub(crate) fn minus<L: Lanes>(l: L, a: Vec3<L>, s: L::V, c: Vec3<L>) -> Vec3<L> {
    [
        l.nmadd(a[0], s, c[0]),
        l.nmadd(a[1], s, c[1]),
        l.nmadd(a[2], s, c[2]),
    ]
}

/// Loads three integer coordinates.
#[inline(always)]
pub(crate) fn load3<L: Lanes>(l: L, x: &[[i32; LANES]; 3]) -> Vec3<L> {
    [l.load_i32(&x[0]), l.load_i32(&x[1]), l.load_i32(&x[2])]
}

/// `a s`.
#[inline(always)]
pub(crate) fn scale<L: Lanes>(l: L, a: Vec3<L>, s: L::V) -> Vec3<L> {
    [l.mul(a[0], s), l.mul(a[1], s), l.mul(a[2], s)]
}

/// `a - b`.
#[inline(always)]
pub(crate) fn diff<L: Lanes>(l: L, a: Vec3<L>, b: Vec3<L>) -> Vec3<L> {
    [l.sub(a[0], b[0]), l.sub(a[1], b[1]), l.sub(a[2], b[2])]
}

/// `a + b`.
#[inline(always)]
pub(crate) fn sum<L: Lanes>(l: L, a: Vec3<L>, b: Vec3<L>) -> Vec3<L> {
    [l.add(a[0], b[0]), l.add(a[1], b[1]), l.add(a[2], b[2])]
}

/// Adds three vectors to `x0 y0 z0 x1 ...` of up to eight particles.
#[inline(always)]
pub(crate) fn add_interleaved<L: Lanes>(l: L, v: Vec3<L>, target: &mut [f64]) {
    let parts = l.interleave(v);
    let (whole, last) = target.as_chunks_mut::<LANES>();
    let done = whole.len();
    for (target, part) in whole.iter_mut().zip(parts) {
        *target = l.store(l.add(l.load(target), part));
    }
    if !last.is_empty() {
        // The tail of a short last block lies in the vector after the whole ones.
        let tail = l.store(parts[done.min(2)]);
        last.iter_mut().zip(tail).for_each(|(target, x)| *target += x);
    }
}
