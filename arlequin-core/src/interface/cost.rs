//! Expected duration of a multiplier solve on several ranks (the model of decision 0046).

/// Assumed latency of a message between two ranks \[s\], and assumed number of neighbours of a rank.
const LATENCY: f64 = 2e-6;
const NEIGHBOURS: f64 = 8.0;
/// Bytes per second between ranks (measured) and from memory (assumed).
const WIRE: f64 = 2.4e9;
const MEMORY: f64 = 8e9;
/// Bytes of an exact sum, and of a matrix entry as it is read.
const SUM: f64 = 8.0 * crate::exact::WORDS as f64;
const ENTRY: f64 = 12.0;

/// Expected duration of a multiplier solve with one solver.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolutionTime {
    /// Name of the solver as in [`super::InterfaceReport::solver`].
    pub solver: &'static str,
    /// Expected duration of one solve \[s\] by a model of machines (decision 0046) with assumed latencies.
    pub seconds: f64,
}

/// Size of a multiplier solve.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Work {
    /// Number of multiplier unknowns.
    pub(super) unknowns: usize,
    /// Number of components that share one operator.
    pub(super) shared: usize,
    /// Number of stored entries of the factor; `None` if a factor is impossible.
    pub(super) factor: Option<usize>,
    /// Number of stored entries of the operator.
    pub(super) operator: usize,
    /// Expected iterations of conjugate gradients.
    pub(super) gradients: f64,
}

impl Work {
    /// Returns the expected durations on `ranks` ranks: that of a factor, if a factor is possible, and that
    /// of conjugate gradients.
    pub(super) fn on(&self, ranks: usize) -> Vec<SolutionTime> {
        let ranks = ranks.max(1) as f64;
        let rounds = ranks.log2();
        // A short reduction runs along a tree, a long one in pieces.
        let reduction = |bytes: f64| {
            let tree = rounds * (LATENCY + bytes / WIRE);
            tree.min(2.0 * (rounds * LATENCY + bytes / WIRE))
        };
        let sum = reduction(SUM * self.shared as f64);
        let broadcast = reduction(8.0 * self.unknowns as f64);
        let neighbours = NEIGHBOURS.min(ranks - 1.0) * LATENCY;
        // Only ranks on one face of a body hold multipliers.
        let product = neighbours + ENTRY * self.operator as f64 / MEMORY / ranks.powf(2.0 / 3.0);
        let solution_time = |solver, seconds: f64| SolutionTime {
            solver,
            seconds: seconds + broadcast,
        };
        // Sixteen bytes: each number is read by the forward and by the backward substitution.
        let factor = self
            .factor
            .map(|e| solution_time("factor", 16.0 * e as f64 / MEMORY));
        // Each iteration has one product and two sums over all ranks.
        let gradients = solution_time("conjugate gradients", self.gradients * (product + 2.0 * sum));
        factor.into_iter().chain([gradients]).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::Work;

    #[test]
    fn iterations_share_out_reading_and_pay_for_sums() {
        let work = Work {
            unknowns: 3000,
            shared: 3,
            factor: Some(400_000),
            operator: 100_000,
            gradients: 50.0,
        };
        // With one rank the only cost is reading entries.
        let times = work.on(1);
        assert!(
            times
                .iter()
                .map(|t| t.solver)
                .eq(["factor", "conjugate gradients"])
        );
        assert!((times[0].seconds - 16.0 * 4e5 / 8e9).abs() < 1e-12);
        assert!((times[1].seconds - 50.0 * 12.0 * 1e5 / 8e9).abs() < 1e-12);
        let gradients = |ranks| {
            let without_factor = Work { factor: None, ..work };
            let times = without_factor.on(ranks);
            assert!(times.iter().map(|t| t.solver).eq(["conjugate gradients"]));
            times[0].seconds
        };
        assert!(gradients(16) < gradients(1) && gradients(16) < gradients(100_000));
    }
}
