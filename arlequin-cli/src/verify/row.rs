//! Rows of the table: a number of ours beside one of the literature, and what is accepted.

use serde::Serialize;

/// What is accepted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Accept {
    /// Relative difference from the reference at most this.
    Relative(f64),
    /// Absolute difference from the reference at most this.
    Absolute(f64),
    /// Modulus at most this.
    AtMost(f64),
    /// At least this.
    AtLeast(f64),
    /// Between these.
    Between(f64, f64),
}

impl Accept {
    fn holds(self, ours: f64, reference: Option<f64>) -> bool {
        let apart = reference.map(|r| (ours - r).abs());
        match self {
            Self::Relative(most) => apart.is_some_and(|d| d <= most * reference.unwrap_or_default().abs()),
            Self::Absolute(most) => apart.is_some_and(|d| d <= most),
            Self::AtMost(most) => ours.abs() <= most,
            Self::AtLeast(least) => ours >= least,
            Self::Between(low, high) => (low..=high).contains(&ours),
        }
    }

    fn text(self) -> String {
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
pub(crate) struct Row {
    /// Case it belongs to.
    pub(crate) case: String,
    /// What is compared, with its unit.
    pub(crate) quantity: String,
    /// The literature's number, if it has one.
    pub(crate) reference: Option<f64>,
    /// Where it is from.
    pub(crate) source: String,
    /// Ours.
    pub(crate) ours: f64,
    /// `(ours − reference)/|reference|`.
    pub(crate) relative_difference: Option<f64>,
    /// What is accepted, in words.
    pub(crate) acceptance: String,
    /// Whether it holds.
    pub(crate) pass: bool,
    /// Why this is accepted, where it needs saying.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub(crate) note: String,
}

impl Row {
    /// A number that must satisfy a condition of its own.
    pub(crate) fn new(quantity: impl Into<String>, ours: f64, accept: Accept) -> Self {
        Self::build(quantity.into(), ours, None, "", accept)
    }

    /// A number beside that of a source.
    pub(crate) fn against(
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
            relative_difference: reference.filter(|r| *r != 0.0).map(|r| (ours - r) / r.abs()),
            acceptance: accept.text(),
            pass: ours.is_finite() && accept.holds(ours, reference),
            note: String::new(),
        }
    }

    /// The same with a remark.
    #[must_use]
    pub(crate) fn note(mut self, text: impl Into<String>) -> Self {
        self.note = text.into();
        self
    }

    fn cells(&self) -> [String; 8] {
        let difference = self.relative_difference;
        [
            self.case.clone(),
            self.quantity.clone(),
            self.reference.map_or_else(|| "-".into(), short),
            self.source.clone(),
            short(self.ours),
            difference.map_or_else(|| "-".into(), |d| format!("{:+.2} %", 100.0 * d)),
            self.acceptance.clone(),
            if self.pass { "pass" } else { "FAIL" }.into(),
        ]
    }
}

const HEAD: [&str; 8] = [
    "case",
    "quantity",
    "reference",
    "source",
    "ours",
    "difference",
    "accepted",
    "",
];

/// Five digits, without an exponent where that is as short.
pub(crate) fn short(x: f64) -> String {
    if x == 0.0 {
        return "0".into();
    }
    if !(1e-3..1e7).contains(&x.abs()) {
        return format!("{x:.3e}");
    }
    let digits = (4 - x.abs().log10().floor() as i32).clamp(0, 6) as usize;
    let text = format!("{x:.digits$}");
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}

/// The table as plain text, remarks below the rows they belong to.
pub(crate) fn table(rows: &[Row]) -> String {
    let cells: Vec<[String; 8]> = rows.iter().map(Row::cells).collect();
    let width: Vec<usize> = (0..8)
        .map(|k| {
            let longest = cells.iter().map(|c| c[k].chars().count()).max();
            longest.unwrap_or(0).max(HEAD[k].chars().count())
        })
        .collect();
    let line = |c: &[String]| {
        let padded = c.iter().zip(&width).map(|(t, w)| format!("{t:<w$}"));
        padded.collect::<Vec<_>>().join("  ").trim_end().to_owned()
    };
    let mut out = line(&HEAD.map(str::to_owned)) + "\n";
    for (row, c) in rows.iter().zip(&cells) {
        out += &(line(c) + "\n");
        if !row.note.is_empty() {
            out += &format!("{:w$}  ({})\n", "", row.note, w = width[0]);
        }
    }
    let failed = rows.iter().filter(|r| !r.pass).count();
    out + &format!("{} rows, {failed} failed\n", rows.len())
}

/// The table as Markdown, one case.
pub(crate) fn markdown(rows: &[&Row]) -> String {
    let mut out = String::from(
        "| quantity | reference | source | ours | difference | accepted | |\n|---|---|---|---|---|---|---|\n",
    );
    for row in rows {
        let c = row.cells();
        let note = if row.note.is_empty() {
            String::new()
        } else {
            format!(" ({})", row.note)
        };
        // A bar would end the cell.
        let cell = format!("{}{note}", c[1]).replace('|', "\\|");
        out += &format!(
            "| {cell} | {} | {} | {} | {} | {} | {} |\n",
            c[2], c[3], c[4], c[5], c[6], c[7]
        );
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn acceptance_is_decided_by_the_numbers() {
        let row = |accept| Row::against("x", 1.02, 1.0, "s", accept);
        assert!(row(Accept::Relative(0.021)).pass && !row(Accept::Relative(0.019)).pass);
        assert!(row(Accept::Absolute(0.021)).pass && !row(Accept::Absolute(0.019)).pass);
        assert!(row(Accept::AtMost(1.03)).pass && !row(Accept::AtLeast(1.03)).pass);
        assert!(row(Accept::Between(1.0, 1.1)).pass && !row(Accept::Between(1.1, 1.2)).pass);
        assert!(!Row::new("x", f64::NAN, Accept::AtMost(1.0)).pass);
        // Without a reference there is nothing to be near to.
        assert!(!Row::new("x", 1.0, Accept::Relative(1.0)).pass);
        let d = row(Accept::AtMost(2.0)).relative_difference;
        assert!(d.is_some_and(|d| (d - 0.02).abs() < 1e-12));
    }

    #[test]
    fn tables_count_failures() {
        let rows = [
            Row::new("good", 1.0, Accept::AtMost(1.0)),
            Row::new("bad", 2.0, Accept::AtMost(1.0)).note("because"),
        ];
        let text = table(&rows);
        assert!(text.ends_with("2 rows, 1 failed\n") && text.contains("FAIL") && text.contains("(because)"));
        assert_eq!(
            (short(0.00012345), short(1606.04)),
            ("1.234e-4".into(), "1606".into())
        );
    }
}
