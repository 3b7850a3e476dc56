//! Snapshots: everything a run must remember to go on with the same bits.
//!
//! A snapshot holds the state, not the models: whoever restores one builds the same run first. Multipliers are kept for
//! reports only; the scheme computes them anew every step.

use crate::coupled::Coupled;
use crate::scalar::check_finite;
use crate::{Error, Real, Result, Subdomain};

/// Numbers and counts of an object whose layout only the object knows: an effect with a history, a model that evolved.
#[derive(Debug, Clone, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Record<T> {
    /// Numbers.
    pub numbers: Vec<T>,
    /// Counts, indices, bit patterns.
    pub integers: Vec<u64>,
}

impl<T> Record<T> {
    /// Checks the lengths of a record against what its object expects.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`], naming `what`.
    pub fn expect(&self, what: &str, numbers: usize, integers: usize) -> Result<()> {
        let lengths = [
            ("numbers", numbers, self.numbers.len()),
            ("integers", integers, self.integers.len()),
        ];
        for (part, expected, found) in lengths {
            if expected != found {
                return Err(Error::SizeMismatch {
                    what: format!("{part} in the record of {what}"),
                    expected,
                    found,
                });
            }
        }
        Ok(())
    }
}

/// What a subdomain must remember.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SubdomainSnapshot<T> {
    /// Displacements \[m\], rotations \[rad\].
    pub q: Vec<T>,
    /// Velocities.
    pub v: Vec<T>,
    /// Accelerations.
    pub a: Vec<T>,
    /// Internal forces at `q`.
    pub internal: Vec<T>,
    /// Works of the effects since the start \[J\].
    pub works: Vec<T>,
    /// Work of the evolution of the model since the start \[J\].
    pub evolved: Option<T>,
    /// What the model remembers.
    pub model: Record<T>,
    /// What the effects remember.
    pub effects: Vec<Record<T>>,
}

/// What an effect between two subdomains must remember.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct PairSnapshot<T> {
    /// Work since the start \[J\].
    pub work: T,
    /// What the effect remembers.
    pub effect: Record<T>,
}

/// What a run must remember.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Snapshot<T> {
    /// Steps made.
    pub step: usize,
    /// Step \[s\]: must be that of the run it is restored into.
    pub dt: T,
    /// Energy removed by the consistent start \[J\].
    pub start_loss: T,
    /// Sums and extremes of the ledger.
    pub ledger: Vec<T>,
    /// Subdomains.
    pub subdomains: Vec<SubdomainSnapshot<T>>,
    /// Multipliers of every interface.
    pub multipliers: Vec<Vec<T>>,
    /// Effects between two subdomains.
    pub pairs: Vec<PairSnapshot<T>>,
}

impl<T: Real> Coupled<T> {
    /// The present state.
    pub fn snapshot(&self) -> Snapshot<T> {
        Snapshot {
            step: self.step,
            dt: self.dt,
            start_loss: self.start_loss,
            ledger: self.ledger.record(),
            subdomains: self.subdomains.iter().map(Subdomain::snapshot).collect(),
            multipliers: self.interfaces.iter().map(|i| i.multipliers().to_vec()).collect(),
            pairs: self.pairs.iter().map(pair_snapshot).collect(),
        }
    }

    /// Goes to a state that the same run had: from here on it makes the same steps, bit by bit.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] or [`Error::InvalidParameter`] where the snapshot does not fit, [`Error::NotFinite`];
    /// the run is then of no use.
    pub fn restore(&mut self, from: &Snapshot<T>) -> Result<()> {
        if from.dt != self.dt {
            let rule = format!("the run has {}; restore into the run that was saved", self.dt);
            return Err(crate::error::invalid("time step of the snapshot", from.dt, &rule));
        }
        same(
            "subdomains of the snapshot",
            self.subdomains.len(),
            from.subdomains.len(),
        )?;
        same(
            "interfaces of the snapshot",
            self.interfaces.len(),
            from.multipliers.len(),
        )?;
        same(
            "effects between two models in the snapshot",
            self.pairs.len(),
            from.pairs.len(),
        )?;
        for (p, f) in self.pairs.iter_mut().zip(&from.pairs) {
            p.effect.restore(&f.effect)?;
            (p.work, p.last_work) = (f.work, T::zero());
        }
        for (s, f) in self.subdomains.iter_mut().zip(&from.subdomains) {
            s.restore(f)?;
        }
        for (i, f) in self.interfaces.iter_mut().zip(&from.multipliers) {
            same("multipliers of the snapshot", i.lambda.len(), f.len())?;
            check_finite("multipliers of the snapshot", f)?;
            i.lambda.copy_from_slice(f);
        }
        self.ledger.restore(&from.ledger)?;
        self.step = from.step;
        self.time = self.start_time + T::of(from.step as f64) * self.dt;
        self.start_loss = from.start_loss;
        Ok(())
    }
}

impl<T: Real> Subdomain<T> {
    fn snapshot(&self) -> SubdomainSnapshot<T> {
        SubdomainSnapshot {
            q: self.state.q.clone(),
            v: self.state.v.clone(),
            a: self.state.a.clone(),
            internal: self.internal.clone(),
            works: self.works.clone(),
            evolved: self.evolved.map(|e| e.work),
            model: self.model().save(),
            effects: self.effects.iter().map(|e| e.save()).collect(),
        }
    }

    fn restore(&mut self, from: &SubdomainSnapshot<T>) -> Result<()> {
        let name = self.model().name().to_owned();
        let parts = [
            ("displacements", &from.q),
            ("velocities", &from.v),
            ("accelerations", &from.a),
            ("internal forces", &from.internal),
        ];
        for (what, x) in parts {
            let what = format!("{what} of '{name}' in the snapshot");
            same(&what, self.state.q.len(), x.len())?;
            check_finite(&what, x)?;
        }
        same(
            &format!("works of '{name}' in the snapshot"),
            self.works.len(),
            from.works.len(),
        )?;
        same(
            &format!("effects of '{name}' in the snapshot"),
            self.effects.len(),
            from.effects.len(),
        )?;
        self.state.q.copy_from_slice(&from.q);
        self.state.v.copy_from_slice(&from.v);
        self.state.a.copy_from_slice(&from.a);
        self.internal.copy_from_slice(&from.internal);
        self.works.copy_from_slice(&from.works);
        if let (Some(line), Some(work)) = (&mut self.evolved, from.evolved) {
            line.work = work;
        }
        self.model_mut().restore(&from.model)?;
        for (e, record) in self.effects.iter_mut().zip(&from.effects) {
            e.restore(record)?;
        }
        Ok(())
    }
}

fn pair_snapshot<T: Real>(p: &crate::effect::Pair<T>) -> PairSnapshot<T> {
    PairSnapshot {
        work: p.work,
        effect: p.effect.save(),
    }
}

fn same(what: &str, expected: usize, found: usize) -> Result<()> {
    if expected == found {
        return Ok(());
    }
    Err(Error::SizeMismatch {
        what: what.to_owned(),
        expected,
        found,
    })
}
