//! Sums without round-off, which no order and no split changes.
//!
//! A finite 64-bit number is an integer of 53 bits times a power of two. The accumulator is one long integer
//! in digits of 32 bits, from the smallest power to the largest (Kulisch). Digits are stored in 64 bits:
//! carries can wait, and ranks can add their digits one by one.

use std::ops::AddAssign;

/// Number of digits: they cover 2⁻¹⁰⁷⁴ to 2⁹⁷¹ and 53 bits more.
const DIGITS: usize = 66;

/// Number of words to send: the digits, and the count of terms that were not finite.
pub(crate) const WORDS: usize = DIGITS + 1;

/// Number of terms after which carries are propagated, long before 64 bits overflow.
const OFTEN: u32 = 1 << 20;

/// Exponent of the lowest bit.
const LOWEST: i32 = -1074;

/// Exact sum of numbers.
///
/// ```
/// use arlequin_core::Exact;
/// let mut sum = Exact::zero();
/// [1e100, 1.0, -1e100].into_iter().for_each(|x| sum.add(x));
/// assert_eq!(sum.value().to_bits(), 1.0_f64.to_bits());
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Exact {
    words: [i64; WORDS],
    since: u32,
}

impl Exact {
    /// Returns a sum of zero.
    #[must_use]
    pub fn zero() -> Self {
        Self {
            words: [0; WORDS],
            since: 0,
        }
    }

    /// Adds a number.
    pub fn add(&mut self, x: f64) {
        if !x.is_finite() {
            self.words[DIGITS] += 1;
            return;
        }
        let bits = x.to_bits();
        let exponent = (bits >> 52) & 0x7ff;
        let fraction = bits & 0x000f_ffff_ffff_ffff;
        // Exponent of the last bit, counted from the lowest one.
        let (mantissa, shift) = match exponent {
            0 => (fraction, 0),
            e => (fraction | 1 << 52, e - 1),
        };
        let (digit, offset) = ((shift / 32) as usize, shift % 32);
        let wide = u128::from(mantissa) << offset;
        let part = |k: u32| ((wide >> (32 * k)) & 0xffff_ffff) as i64;
        let sign = if x.is_sign_negative() { -1 } else { 1 };
        // 53 bits, shifted by up to 31, reach into three digits.
        for (k, word) in (0..).zip(&mut self.words[digit..(digit + 3).min(DIGITS)]) {
            *word += sign * part(k);
        }
        self.since += 1;
        if self.since >= OFTEN {
            self.carry();
        }
    }

    /// Propagates carries: all digits but the last are then below 2³² and not negative.
    fn carry(&mut self) {
        let mut carry = 0;
        for word in &mut self.words[..DIGITS - 1] {
            let sum = *word + carry;
            carry = sum >> 32;
            *word = sum & 0xffff_ffff;
        }
        self.words[DIGITS - 1] += carry;
        self.since = 0;
    }

    /// Returns words that may be added up over ranks, word by word, for up to 2³⁰ ranks.
    #[must_use]
    pub fn words(mut self) -> [i64; WORDS] {
        self.carry();
        self.words
    }

    /// Makes a sum from [`Self::words`], or from added-up words of several sums.
    #[must_use]
    pub fn from_words(words: [i64; WORDS]) -> Self {
        let mut out = Self { words, since: 0 };
        out.carry();
        out
    }

    /// Returns the sum, rounded once (twice below 2⁻¹⁰²²); NaN if a term was not finite.
    #[must_use]
    pub fn value(mut self) -> f64 {
        if self.words[DIGITS] != 0 {
            return f64::NAN;
        }
        self.carry();
        // After a carry only the last digit has a sign: it is that of the sum.
        let negative = self.words[DIGITS - 1] < 0;
        if negative {
            self.words.iter_mut().for_each(|w| *w = -*w);
            self.carry();
        }
        let digits = &self.words[..DIGITS];
        let Some(top) = digits.iter().rposition(|w| *w != 0) else {
            return 0.0;
        };
        let low = top.saturating_sub(2);
        let leading = digits[low..=top].iter().rev();
        let leading = leading.fold(0_u128, |value, w| (value << 32) + u128::from(w.unsigned_abs()));
        // Lower digits only decide on which side of a half the sum lies: one sticky bit keeps that.
        let sticky = u128::from(digits[..low].iter().any(|w| *w != 0));
        let exponent = 32 * low as i32 + LOWEST;
        // The power is split into two factors, as one alone may be out of range.
        let size = (leading | sticky) as f64 * power(exponent / 2) * power(exponent - exponent / 2);
        if negative { -size } else { size }
    }
}

/// Returns `2^k` for `k` between -1022 and 1023.
fn power(k: i32) -> f64 {
    f64::from_bits(((k + 1023) as u64) << 52)
}

impl AddAssign for Exact {
    fn add_assign(&mut self, other: Self) {
        self.carry();
        for (a, b) in self.words.iter_mut().zip(other.words()) {
            *a += b;
        }
        // Both operands are carried: the sum has waited for one term.
        self.since = 1;
    }
}

#[cfg(test)]
mod tests {
    use super::Exact;

    fn sum(x: impl Iterator<Item = f64>) -> f64 {
        let mut total = Exact::zero();
        x.for_each(|x| total.add(x));
        total.value()
    }

    #[test]
    fn one_number_comes_back_with_its_bits() {
        let extremes = [
            0.0,
            1.0,
            -1.0,
            f64::MAX,
            f64::MIN,
            f64::MIN_POSITIVE,
            -f64::MIN_POSITIVE / 8.0,
            f64::from_bits(1),
            1e300,
            -3.7e-290,
        ];
        for x in extremes {
            assert_eq!(sum([x].into_iter()).to_bits(), x.to_bits(), "{x:e}");
        }
        assert!(sum([1.0, f64::INFINITY].into_iter()).is_nan());
        assert!(sum([f64::NAN].into_iter()).is_nan());
        assert!(sum([f64::MAX, f64::MAX].into_iter()).is_infinite());
    }

    /// Compares with 128-bit integers: terms are multiples of 2⁻⁴⁰ below 2⁴⁰.
    #[test]
    fn sums_are_rounded_once_whatever_their_order_and_cuts() {
        let step = (-40.0_f64).exp2();
        let term =
            |i: i64| (i.wrapping_mul(0x5851_f42d_4c95_7f2d) % (1 << 50)) - (1 << 49) + (i % 3) * (1 << 60);
        let exact: i128 = (1..5000).map(|i| i128::from(term(i) >> 10 << 10)).sum();
        let wanted = exact as f64 * step;
        let x: Vec<f64> = (1..5000).map(|i| (term(i) >> 10 << 10) as f64 * step).collect();
        assert_eq!(sum(x.iter().copied()).to_bits(), wanted.to_bits());
        assert_eq!(sum(x.iter().rev().copied()).to_bits(), wanted.to_bits());
        for cuts in [1, 2, 7, 300] {
            let mut total = Exact::zero();
            for part in x.chunks(x.len().div_ceil(cuts)) {
                let mut local = Exact::zero();
                part.iter().for_each(|x| local.add(*x));
                total += Exact::from_words(local.words());
            }
            assert_eq!(total.value().to_bits(), wanted.to_bits(), "{cuts} cuts");
        }
        let tie = [1.0, f64::EPSILON / 2.0];
        assert_eq!(sum(tie.into_iter()).to_bits(), 1.0_f64.to_bits());
        let above = [1.0, f64::EPSILON / 2.0, 1e-300];
        assert_eq!(sum(above.into_iter()).to_bits(), (1.0 + f64::EPSILON).to_bits());
    }
}
