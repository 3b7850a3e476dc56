//! Linear isotropic elasticity: `σ = λ tr(ε) I + 2 μ ε`.

use crate::error::{Result, parameter};

/// A homogeneous isotropic elastic material.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Elastic {
    young: f64,
    poisson: f64,
    density: f64,
}

impl Elastic {
    /// Material with Young's modulus `E` \[Pa\], Poisson's ratio `ν` \[–\] and density `ρ` \[kg/m³\].
    ///
    /// ```
    /// let silica = cnem::Elastic::new(72.5e9, 0.17, 2200.0)?;
    /// assert!((silica.lame()[1] - 72.5e9 / 2.34).abs() < 1e-3);
    /// # Ok::<(), cnem::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`crate::Error::Parameter`] unless `E > 0`, `−1 < ν < 0.5`, `ρ > 0` and all are finite.
    pub fn new(young: f64, poisson: f64, density: f64) -> Result<Self> {
        let positive = |x: f64| x.is_finite() && x > 0.0;
        if !positive(young) {
            return Err(parameter("young", young, "must be positive and finite [Pa]"));
        }
        if !(poisson > -1.0 && poisson < 0.5) {
            return Err(parameter(
                "poisson",
                poisson,
                "must lie between -1 and 0.5; nearly incompressible materials take a value such as 0.49",
            ));
        }
        if !positive(density) {
            return Err(parameter(
                "density",
                density,
                "must be positive and finite [kg/m3]",
            ));
        }
        Ok(Self {
            young,
            poisson,
            density,
        })
    }

    /// Young's modulus `E` \[Pa\].
    pub fn young(&self) -> f64 {
        self.young
    }

    /// Poisson's ratio `ν` \[–\].
    pub fn poisson(&self) -> f64 {
        self.poisson
    }

    /// Density `ρ` \[kg/m³\].
    pub fn density(&self) -> f64 {
        self.density
    }

    /// Lamé's `λ = E ν / ((1 + ν)(1 − 2ν))` and `μ = E / (2 (1 + ν))` \[Pa\].
    pub fn lame(&self) -> [f64; 2] {
        let nu = self.poisson;
        [
            self.young * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)),
            self.young / (2.0 * (1.0 + nu)),
        ]
    }
}
