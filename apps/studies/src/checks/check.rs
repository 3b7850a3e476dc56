//! A check: our number, the literature's number if there is one, and the accepted range.

use serde::Serialize;

/// Condition on our number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Accept {
    /// The relative difference from the reference is at most this.
    Relative(f64),
    /// The absolute difference from the reference is at most this.
    Absolute(f64),
    /// The modulus is at most this.
    AtMost(f64),
    /// The number is finite and at least this.
    AtLeast(f64),
    /// The number lies between these.
    Between(f64, f64),
}

impl Accept {
    fn holds(self, ours: f64, reference: Option<f64>) -> bool {
        // Without a reference, neither a relative nor an absolute difference can hold.
        let apart = reference.map(|r| (ours - r).abs());
        match self {
            // Not `d > …`: a NaN must fail.
            Self::Relative(most) => apart.is_some_and(|d| d <= most * reference.unwrap_or_default().abs()),
            Self::Absolute(most) => apart.is_some_and(|d| d <= most),
            Self::AtMost(most) => ours.abs() <= most,
            Self::AtLeast(least) => ours >= least && ours.is_finite(),
            Self::Between(low, high) => (low..=high).contains(&ours),
        }
    }

    /// Returns the condition in words.
    pub fn text(self) -> String {
        match self {
            Self::Relative(most) => format!("within {} %", short(100.0 * most)),
            Self::Absolute(most) => format!("within {}", short(most)),
            Self::AtMost(most) => format!("at most {}", short(most)),
            Self::AtLeast(least) => format!("at least {}", short(least)),
            Self::Between(low, high) => format!("{} to {}", short(low), short(high)),
        }
    }
}

/// One comparison.
#[derive(Debug, Clone, Serialize)]
pub struct Check {
    /// Case that the check belongs to.
    pub case: String,
    /// Compared quantity, with its unit.
    pub quantity: String,
    /// Number of the literature, if there is one.
    pub reference: Option<f64>,
    /// Source of that number.
    pub source: String,
    /// Our number.
    pub ours: f64,
    /// `(ours − reference)/|reference|`.
    pub relative_difference: Option<f64>,
    /// Condition on our number.
    #[serde(rename = "acceptance")]
    pub accept: Accept,
    /// True if the condition holds.
    pub pass: bool,
    /// Reason for the condition or remark; empty if none is needed.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub note: String,
    /// True if the check is a row of the table. Otherwise it is a bound of our own and is shown only if it
    /// fails.
    #[serde(skip)]
    pub listed: bool,
}

impl Check {
    /// Returns a check without a reference.
    pub fn new(quantity: impl Into<String>, ours: f64, accept: Accept) -> Self {
        Self::build(quantity.into(), ours, None, "", accept)
    }

    /// Returns a check against the number of a source.
    pub fn against(
        quantity: impl Into<String>,
        ours: f64,
        reference: f64,
        source: &str,
        accept: Accept,
    ) -> Self {
        Self::build(quantity.into(), ours, Some(reference), source, accept)
    }

    fn build(quantity: String, ours: f64, reference: Option<f64>, source: &str, accept: Accept) -> Self {
        Self {
            case: String::new(),
            quantity,
            reference,
            source: source.to_owned(),
            ours,
            // A reference of zero has no relative difference.
            relative_difference: reference.filter(|r| *r != 0.0).map(|r| (ours - r) / r.abs()),
            accept,
            pass: accept.holds(ours, reference),
            note: String::new(),
            listed: true,
        }
    }

    /// Returns a check of the mean over several packings, with half of the range as its remark.
    pub(super) fn over_seeds(quantity: &str, values: &[f64], accept: Accept) -> Self {
        let [mean, half] = spread(values);
        let check = Self::new(quantity, mean, accept);
        check.note(format!("± {half:.3} over {} seeds", values.len()))
    }

    /// Takes a reference, with its source, to which the check is compared.
    #[must_use]
    pub(super) fn beside(self, reference: f64, source: &str) -> Self {
        let with = Self::build(self.quantity, self.ours, Some(reference), source, self.accept);
        with.note(self.note)
    }

    /// Takes the check out of the table, unless it fails.
    #[must_use]
    pub fn unlisted(mut self) -> Self {
        self.listed = false;
        self
    }

    /// Adds a remark.
    #[must_use]
    pub fn note(mut self, text: impl Into<String>) -> Self {
        self.note = text.into();
        self
    }
}

/// Mean and half of the range of numbers.
pub(super) fn spread(values: &[f64]) -> [f64; 2] {
    let n = values.len() as f64;
    let (low, high) = values
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| {
            (a.min(*x), b.max(*x))
        });
    [values.iter().sum::<f64>() / n, 0.5 * (high - low)]
}

impl Serialize for Accept {
    fn serialize<S: serde::Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        to.serialize_str(&self.text())
    }
}

/// Formats a number with five digits, without an exponent where that is as short.
pub fn short(x: f64) -> String {
    if x == 0.0 {
        return "0".into();
    }
    if !(1e-3..1e7).contains(&x.abs()) {
        return format!("{x:.3e}");
    }
    // Five digits in all.
    let digits = (4 - x.abs().log10().floor() as i32).clamp(0, 6) as usize;
    let text = format!("{x:.digits$}");
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn acceptance_is_decided_by_the_numbers() {
        let row = |accept| Check::against("x", 1.02, 1.0, "s", accept);
        assert!(row(Accept::Relative(0.021)).pass && !row(Accept::Relative(0.019)).pass);
        assert!(row(Accept::Absolute(0.021)).pass && !row(Accept::Absolute(0.019)).pass);
        assert!(row(Accept::AtMost(1.03)).pass && !row(Accept::AtLeast(1.03)).pass);
        assert!(row(Accept::Between(1.0, 1.1)).pass && !row(Accept::Between(1.1, 1.2)).pass);
        assert!(!Check::new("x", f64::NAN, Accept::AtMost(1.0)).pass);
        assert!(!Check::new("x", f64::INFINITY, Accept::AtLeast(1.0)).pass);
        assert!(Check::new("x", f64::INFINITY, Accept::Between(1.0, f64::INFINITY)).pass);
        // Without a reference a relative difference has no meaning.
        assert!(!Check::new("x", 1.0, Accept::Relative(1.0)).pass);
        let d = row(Accept::AtMost(2.0)).relative_difference;
        assert!(d.is_some_and(|d| (d - 0.02).abs() < 1e-12));
    }
}
