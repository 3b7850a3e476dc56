//! The lanes of AVX-512 (one register per vector) and of AVX2 with FMA (two registers per vector).

use super::lanes::{CacheLine, Job, LANES, Lanes, eight, elementwise};
use core::arch::x86_64::{__m256d, __m512d};
use pulp::x86::{V3, V4};
use pulp::{NullaryFnOnce, cast};

struct Call<J>(J);

impl<J: Job> NullaryFnOnce for Call<J> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        self.0.call();
    }
}

/// AVX-512.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Wide512(pub(crate) V4);

/// Shuffles 128-bit blocks of four vectors in two stages, after the pairwise unpacks.
#[inline(always)]
fn blocks(s: V4, t: [__m512d; 4]) -> [__m512d; 4] {
    let f = s.avx512f;
    let u0 = f._mm512_shuffle_f64x2::<0x88>(t[0], t[1]);
    let u1 = f._mm512_shuffle_f64x2::<0x88>(t[2], t[3]);
    let u2 = f._mm512_shuffle_f64x2::<0xdd>(t[0], t[1]);
    let u3 = f._mm512_shuffle_f64x2::<0xdd>(t[2], t[3]);
    [
        f._mm512_shuffle_f64x2::<0x88>(u0, u1),
        f._mm512_shuffle_f64x2::<0x88>(u2, u3),
        f._mm512_shuffle_f64x2::<0xdd>(u0, u1),
        f._mm512_shuffle_f64x2::<0xdd>(u2, u3),
    ]
}

#[inline(always)]
fn turn512(s: V4, r: [__m512d; 8]) -> [__m512d; 8] {
    let f = s.avx512f;
    let lo = [
        f._mm512_unpacklo_pd(r[0], r[1]),
        f._mm512_unpacklo_pd(r[2], r[3]),
        f._mm512_unpacklo_pd(r[4], r[5]),
        f._mm512_unpacklo_pd(r[6], r[7]),
    ];
    let hi = [
        f._mm512_unpackhi_pd(r[0], r[1]),
        f._mm512_unpackhi_pd(r[2], r[3]),
        f._mm512_unpackhi_pd(r[4], r[5]),
        f._mm512_unpackhi_pd(r[6], r[7]),
    ];
    // Pairs first, then quarters, then halves: 24 shuffles for 64 numbers.
    let (e, o) = (blocks(s, lo), blocks(s, hi));
    [e[0], o[0], e[1], o[1], e[2], o[2], e[3], o[3]]
}

impl Lanes for Wide512 {
    type V = __m512d;
    #[inline(always)]
    fn run<J: Job>(self, job: J) {
        self.0.vectorize(Call(job));
    }
    #[inline(always)]
    fn splat(self, x: f64) -> __m512d {
        self.0.avx512f._mm512_set1_pd(x)
    }
    #[inline(always)]
    fn load(self, x: &[f64; LANES]) -> __m512d {
        cast(*x)
    }
    #[inline(always)]
    fn load_i32(self, x: &[i32; LANES]) -> __m512d {
        self.0.avx512f._mm512_cvtepi32_pd(cast(*x))
    }
    #[inline(always)]
    fn load_f32(self, x: &[f32; LANES]) -> __m512d {
        self.0.avx512f._mm512_cvtps_pd(cast(*x))
    }
    #[inline(always)]
    fn store(self, x: __m512d) -> [f64; LANES] {
        cast(x)
    }
    elementwise! {
        add(s, a, b) => s.0.avx512f._mm512_add_pd(a, b);
        sub(s, a, b) => s.0.avx512f._mm512_sub_pd(a, b);
        mul(s, a, b) => s.0.avx512f._mm512_mul_pd(a, b);
        div(s, a, b) => s.0.avx512f._mm512_div_pd(a, b);
        // An estimate of 14 bits with two Newton steps was 9 % slower in the finite law, where the other
        // units are busy while the divider works.
        recip(s, a) => { let f = s.0.avx512f; f._mm512_div_pd(f._mm512_set1_pd(1.0), a) };
        sqrt(s, a) => s.0.avx512f._mm512_sqrt_pd(a);
        madd(s, a, b, c) => s.0.avx512f._mm512_fmadd_pd(a, b, c);
        nmadd(s, a, b, c) => s.0.avx512f._mm512_fnmadd_pd(a, b, c);
        // The order of the arguments matters: the instruction returns the second one where the first is not a
        // number.
        max(s, a, b) => s.0.avx512f._mm512_max_pd(a, b);
    }
    #[inline(always)]
    fn transpose(self, rows: [[f64; LANES]; LANES]) -> [__m512d; LANES] {
        turn512(self.0, eight!(k => cast(rows[k])))
    }
    #[inline(always)]
    fn untranspose(self, v: [__m512d; LANES]) -> [[f64; LANES]; LANES] {
        let t = turn512(self.0, v);
        eight!(k => cast(t[k]))
    }
    #[inline(always)]
    fn interleave(self, [x, y, z]: [__m512d; 3]) -> [__m512d; 3] {
        let f = self.0.avx512f;
        // Indices into x and y (8 and above) for each part, then into this part and z (8 and above).
        let a = f._mm512_permutex2var_pd(x, cast([0_u64, 8, 0, 1, 9, 0, 2, 10]), y);
        let b = f._mm512_permutex2var_pd(x, cast([0_u64, 3, 11, 0, 4, 12, 0, 5]), y);
        let c = f._mm512_permutex2var_pd(x, cast([13_u64, 0, 6, 14, 0, 7, 15, 0]), y);
        [
            f._mm512_permutex2var_pd(a, cast([0_u64, 1, 8, 3, 4, 9, 6, 7]), z),
            f._mm512_permutex2var_pd(b, cast([10_u64, 1, 2, 11, 4, 5, 12, 7]), z),
            f._mm512_permutex2var_pd(c, cast([0_u64, 13, 2, 3, 14, 5, 6, 15]), z),
        ]
    }
    #[inline(always)]
    fn prefetch(self, row: *const CacheLine) {
        self.0
            .sse
            ._mm_prefetch::<{ core::arch::x86_64::_MM_HINT_T0 }>(row.cast());
    }
}

/// AVX2 with FMA, two registers per vector.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Wide256(pub(crate) V3);

macro_rules! both {
    ($k:ident => $e:expr) => {
        [
            {
                let $k = 0;
                $e
            },
            {
                let $k = 1;
                $e
            },
        ]
    };
}

/// Transposes 4 x 4 numbers.
#[inline(always)]
fn turn4(s: V3, r: [__m256d; 4]) -> [__m256d; 4] {
    let a = s.avx;
    let t0 = a._mm256_unpacklo_pd(r[0], r[1]);
    let t1 = a._mm256_unpackhi_pd(r[0], r[1]);
    let t2 = a._mm256_unpacklo_pd(r[2], r[3]);
    let t3 = a._mm256_unpackhi_pd(r[2], r[3]);
    [
        a._mm256_permute2f128_pd::<0x20>(t0, t2),
        a._mm256_permute2f128_pd::<0x20>(t1, t3),
        a._mm256_permute2f128_pd::<0x31>(t0, t2),
        a._mm256_permute2f128_pd::<0x31>(t1, t3),
    ]
}

#[inline(always)]
fn turn256(s: V3, r: [[__m256d; 2]; 8]) -> [[__m256d; 2]; 8] {
    let a = turn4(s, [r[0][0], r[1][0], r[2][0], r[3][0]]);
    let b = turn4(s, [r[4][0], r[5][0], r[6][0], r[7][0]]);
    let c = turn4(s, [r[0][1], r[1][1], r[2][1], r[3][1]]);
    let d = turn4(s, [r[4][1], r[5][1], r[6][1], r[7][1]]);
    [
        [a[0], b[0]],
        [a[1], b[1]],
        [a[2], b[2]],
        [a[3], b[3]],
        [c[0], d[0]],
        [c[1], d[1]],
        [c[2], d[2]],
        [c[3], d[3]],
    ]
}

impl Lanes for Wide256 {
    type V = [__m256d; 2];
    #[inline(always)]
    fn run<J: Job>(self, job: J) {
        self.0.vectorize(Call(job));
    }
    #[inline(always)]
    fn splat(self, x: f64) -> Self::V {
        [self.0.avx._mm256_set1_pd(x); 2]
    }
    #[inline(always)]
    fn load(self, x: &[f64; LANES]) -> Self::V {
        cast(*x)
    }
    #[inline(always)]
    fn load_i32(self, x: &[i32; LANES]) -> Self::V {
        let halves: [[i32; 4]; 2] = cast(*x);
        both!(k => self.0.avx._mm256_cvtepi32_pd(cast(halves[k])))
    }
    #[inline(always)]
    fn load_f32(self, x: &[f32; LANES]) -> Self::V {
        let halves: [[f32; 4]; 2] = cast(*x);
        both!(k => self.0.avx._mm256_cvtps_pd(cast(halves[k])))
    }
    #[inline(always)]
    fn store(self, x: Self::V) -> [f64; LANES] {
        cast(x)
    }
    elementwise! {
        add(s, a, b) => both!(k => s.0.avx._mm256_add_pd(a[k], b[k]));
        sub(s, a, b) => both!(k => s.0.avx._mm256_sub_pd(a[k], b[k]));
        mul(s, a, b) => both!(k => s.0.avx._mm256_mul_pd(a[k], b[k]));
        div(s, a, b) => both!(k => s.0.avx._mm256_div_pd(a[k], b[k]));
        recip(s, a) => { let one = s.0.avx._mm256_set1_pd(1.0); both!(k => s.0.avx._mm256_div_pd(one, a[k])) };
        sqrt(s, a) => both!(k => s.0.avx._mm256_sqrt_pd(a[k]));
        madd(s, a, b, c) => both!(k => s.0.fma._mm256_fmadd_pd(a[k], b[k], c[k]));
        nmadd(s, a, b, c) => both!(k => s.0.fma._mm256_fnmadd_pd(a[k], b[k], c[k]));
        max(s, a, b) => both!(k => s.0.avx._mm256_max_pd(a[k], b[k]));
    }
    #[inline(always)]
    fn transpose(self, rows: [[f64; LANES]; LANES]) -> [Self::V; LANES] {
        turn256(self.0, eight!(k => cast(rows[k])))
    }
    #[inline(always)]
    fn untranspose(self, v: [Self::V; LANES]) -> [[f64; LANES]; LANES] {
        let t = turn256(self.0, v);
        eight!(k => cast(t[k]))
    }
    #[inline(always)]
    fn prefetch(self, row: *const CacheLine) {
        self.0
            .sse
            ._mm_prefetch::<{ core::arch::x86_64::_MM_HINT_T0 }>(row.cast());
    }
}
