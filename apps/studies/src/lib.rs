//! Cases of the literature that tests, benches and `arlequin verify` share. Each builds a coupled run or
//! returns the numbers of a claim. The expected numbers are in one table, [`checks`], and for hard cases in
//! [`hard`].

pub mod bauman;
pub mod cantilever;
pub mod checks;
pub mod claims;
pub mod crack;
pub mod hard;
pub mod line;
pub mod moving;
pub mod solid;
pub mod strain;
pub mod waves;

/// Returns a generator of reproducible uniform random numbers in (−1, 1).
pub fn noise(seed: u64) -> impl FnMut() -> f64 {
    let mut s = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    // The xorshift generator with shifts 13, 7, 17; its 53 highest bits become the number.
    move || {
        s ^= s << 13;
        s ^= s >> 7;
        s ^= s << 17;
        (s >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}
