//! Linear isotropic elasticity, the material that all continuum models share: `σ = λ tr(ε) I + 2 μ ε`.

use crate::error::invalid;
use crate::recovery::SymmetricTensor;
use crate::{Real, Result};

/// Least value of `1 − 2ν` (about `μ/λ`) and of `1 + ν` (its counterpart at the other end). Displacement
/// elements lock where `λ/μ` exceeds `(L/h)²`. Beyond this limit a body must be more than a hundred elements
/// long for results of the right order. A block of 16 by 4 by 4 hexahedra moved by 35 % of the true
/// displacement at `1 − 2ν = 2e-4`, by 0.6 % at 2e-6 and by 6e-7 of it at 2e-10.
const LEAST: f64 = 1e-4;

/// A homogeneous isotropic elastic material.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Elastic<T> {
    young: T,
    poisson: T,
    density: T,
}

impl<T: Real> Elastic<T> {
    /// Material with Young's modulus `E` \[Pa\], Poisson's ratio `ν` \[–\] and density `ρ` \[kg/m³\].
    ///
    /// ```
    /// use arlequin_core::Elastic;
    /// let silica = Elastic::new(72.5e9f64, 0.17, 2200.0)?;
    /// assert!((silica.bar_speed() - 5740.6).abs() < 0.1);
    /// # Ok::<(), arlequin_core::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`crate::Error::InvalidParameter`] unless `E > 0`, `−1 + 1e-4 ≤ ν ≤ 0.5 − 5e-5`, `ρ > 0` and all are
    /// finite.
    pub fn new(young: T, poisson: T, density: T) -> Result<Self> {
        let positive = |x: T| x.is_finite() && x > T::zero();
        if !positive(young) {
            return Err(invalid("young", young, "must be positive and finite [Pa]"));
        }
        // Its own message: 0.5 is what textbooks give for rubber, and the remedy differs.
        if poisson == T::of(0.5) {
            return Err(invalid(
                "poisson",
                poisson,
                "an incompressible material has no finite bulk modulus in a displacement model; use a value below 0.5; elements of first order lock near it, so that 0.45 is a better choice than 0.49",
            ));
        }
        if !(poisson > -T::one() && poisson < T::of(0.5)) {
            return Err(invalid("poisson", poisson, "must lie between -1 and 0.5"));
        }
        let least = T::of(LEAST);
        if T::one() - poisson - poisson < least || T::one() + poisson < least {
            let rule = format!(
                "must lie between -1 + {LEAST:e} and 0.5 - {:e}: nearer to -1 or 0.5 one modulus is more than {:e} times the other, and \
                 displacements of elements are a small part of the body's; take 0.45 or less for what hardly changes its \
                 volume, as elements of first order lock above",
                0.5 * LEAST,
                1.0 / LEAST
            );
            return Err(invalid("poisson", poisson, &rule));
        }
        if !positive(density) {
            return Err(invalid("density", density, "must be positive and finite [kg/m3]"));
        }
        Ok(Self {
            young,
            poisson,
            density,
        })
    }

    /// Young's modulus `E` \[Pa\].
    pub fn young(&self) -> T {
        self.young
    }

    /// Poisson's ratio `ν` \[–\].
    pub fn poisson(&self) -> T {
        self.poisson
    }

    /// Density `ρ` \[kg/m³\].
    pub fn density(&self) -> T {
        self.density
    }

    /// Lamé's `[λ, μ]`, `λ = E ν / ((1 + ν)(1 − 2ν))` and `μ = E / (2 (1 + ν))` \[Pa\].
    pub fn lame(&self) -> [T; 2] {
        let one = T::one();
        let mu = self.young / (T::of(2.0) * (one + self.poisson));
        let lambda = self.young * self.poisson / ((one + self.poisson) * (one - self.poisson - self.poisson));
        [lambda, mu]
    }

    /// Stress of a strain, `λ tr ε 1 + 2 μ ε` \[Pa\].
    pub fn stress(&self, strain: &SymmetricTensor<T>) -> SymmetricTensor<T> {
        let [lambda, mu] = self.lame();
        let [xx, yy, zz, ..] = strain.0;
        let mut out = SymmetricTensor(strain.0.map(|e| (mu + mu) * e));
        let pressure = lambda * (xx + yy + zz);
        out.0[..3].iter_mut().for_each(|s| *s += pressure);
        out
    }

    /// P-wave modulus `λ + 2 μ = E (1 − ν) / ((1 + ν)(1 − 2ν))` \[Pa\].
    pub fn p_wave_modulus(&self) -> T {
        let (one, two) = (T::one(), T::of(2.0));
        self.young * (one - self.poisson) / ((one + self.poisson) * (one - two * self.poisson))
    }

    /// Speed of dilatational waves, `c = √((λ + 2 μ)/ρ)` \[m/s\].
    pub fn p_wave_speed(&self) -> T {
        (self.p_wave_modulus() / self.density).sqrt()
    }

    /// Speed of long axial waves in a bar, `c = √(E/ρ)` \[m/s\].
    pub fn bar_speed(&self) -> T {
        (self.young / self.density).sqrt()
    }
}

/// Materials of a body: one for all elements, or one for each.
#[derive(Debug, Clone, PartialEq)]
pub struct Materials<T> {
    materials: Vec<Elastic<T>>,
    /// Number of each element's material; empty for one material.
    numbers: Vec<u32>,
}

impl<T: Real> From<Elastic<T>> for Materials<T> {
    fn from(material: Elastic<T>) -> Self {
        Self {
            materials: vec![material],
            numbers: Vec::new(),
        }
    }
}

impl<T: Real> Materials<T> {
    /// Several materials, and the number of each element's material.
    ///
    /// ```
    /// use arlequin_core::{Elastic, Materials};
    /// let [steel, rubber] = [Elastic::new(210e9, 0.3, 7850.0)?, Elastic::new(1e6, 0.49, 1100.0)?];
    /// let plate = Materials::of_elements(vec![steel, rubber], vec![0, 0, 1])?;
    /// assert_eq!(plate.at(2).young(), 1e6);
    /// # Ok::<(), arlequin_core::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`crate::Error::InvalidParameter`] for a number that no material has.
    pub fn of_elements(materials: Vec<Elastic<T>>, numbers: Vec<u32>) -> Result<Self> {
        match numbers.iter().find(|k| **k as usize >= materials.len()) {
            Some(k) => Err(crate::Error::InvalidParameter {
                name: "material of an element".into(),
                value: k.to_string(),
                rule: format!("there are {}, counted from 0", materials.len()),
            }),
            None => Ok(Self { materials, numbers }),
        }
    }

    /// Material of an element.
    ///
    /// # Panics
    /// For an element beyond those whose materials were given.
    pub fn at(&self, element: usize) -> &Elastic<T> {
        let number = if self.numbers.is_empty() {
            0
        } else {
            self.numbers[element]
        };
        &self.materials[number as usize]
    }

    /// Materials of some elements, in the given order.
    ///
    /// # Panics
    /// For an element beyond those whose materials were given.
    #[must_use]
    pub fn of_some(&self, elements: impl Iterator<Item = usize>) -> Self {
        // One material for all elements has no numbers to restrict.
        let varies = !self.numbers.is_empty();
        Self {
            materials: self.materials.clone(),
            numbers: elements.filter(|_| varies).map(|e| self.numbers[e]).collect(),
        }
    }

    /// All materials.
    pub fn all(&self) -> &[Elastic<T>] {
        &self.materials
    }

    /// Number of elements whose materials were given; `None` for one material.
    pub fn elements(&self) -> Option<usize> {
        (!self.numbers.is_empty()).then_some(self.numbers.len())
    }
}
