//! The three energies that models share.

/// Energy that a weight divides among models.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Share {
    /// Internal energy, `α`.
    Internal,
    /// Kinetic energy, `β`.
    Kinetic,
    /// External work, `γ`.
    External,
}

impl std::fmt::Display for Share {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Internal => "internal energy (alpha)",
            Self::Kinetic => "kinetic energy (beta)",
            Self::External => "external work (gamma)",
        })
    }
}
