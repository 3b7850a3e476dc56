//! Requirements of a run on models that are partitioned among ranks.

use super::apart::Overlap;
use super::own_steps::Held;
use crate::effect::PairSpec;
use crate::interface::joint::Joint;
use crate::interface::{Interface, InterfaceSpec};
use crate::subdomain::{OwnStep, Subdomain};
use crate::{Error, Owned, Real, Result};

/// Refuses combinations that partitioned models do not support.
pub(super) fn check<T: Real>(
    subdomains: &[Subdomain<T>],
    interfaces: &[InterfaceSpec<T>],
    pairs: &[PairSpec<T>],
) -> Result<()> {
    for (k, s) in subdomains.iter().enumerate() {
        let owned = s.owned();
        let held = owned.is_part().then(|| owned.ranks());
        let Some(ranks) = held.or_else(|| s.ranks()) else {
            continue;
        };
        let tied = interfaces.iter().find(|i| [i.coarse, i.fine].contains(&k));
        let tied = tied.filter(|_| held.is_some());
        let why = if let Some(i) = tied {
            let (name, how) = (&i.name, "the run must share it out itself (Subdomain::shared)");
            return Err(Error::Unsupported {
                model: s.model().name().to_owned(),
                what: format!("be tied by interface '{name}' where it is in parts already; {how}"),
            });
        } else if pairs.iter().any(|p| p.sides.contains(&k)) {
            "touch another model".to_owned()
        } else if s.step_choice() == OwnStep::Implicit {
            "step implicitly".to_owned()
        } else {
            continue;
        };
        return Err(Error::Unsupported {
            model: s.model().name().to_owned(),
            what: format!("{why} while it is in parts on {ranks} ranks; run it on one"),
        });
    }
    Ok(())
}

/// Partitions the models that are marked for it, and the interfaces, overlaps and supports that act on their
/// nodes.
pub(super) fn partition_models<T: Real>(
    subdomains: &mut [Subdomain<T>],
    interfaces: &mut [Interface<T>],
    joints: &mut [Joint<T>],
    overlaps: &mut [Overlap<T>],
    held: &mut [Held<T>],
) -> Result<()> {
    subdomains.iter_mut().try_for_each(Subdomain::partition_model)?;
    let owned: Vec<_> = subdomains.iter().map(Subdomain::owned).collect();
    for ((i, overlap), held) in interfaces.iter_mut().zip(overlaps).zip(held) {
        let of_sides = i.sides().map(|s| &owned[s]);
        i.restrict(of_sides);
        overlap.restrict(of_sides);
        held.restrict(of_sides);
    }
    joints.iter_mut().for_each(|j| j.restrict(&owned));
    Ok(())
}

/// Returns the first error of the communication between ranks, if there was one.
pub(super) fn check_communication<T: Real>(subdomains: &[Subdomain<T>]) -> Result<()> {
    subdomains
        .iter()
        .try_for_each(|s| s.owned().check_communication())
}

/// Checks that the energy has the same bits on all ranks: each rank computes models that are not partitioned
/// by itself. Collective.
pub(super) fn agree<T: Real>(subdomains: &[Subdomain<T>], energy: T, step: usize) -> Result<()> {
    let Some(owned) = subdomains.iter().map(Subdomain::owned).find(Owned::is_part) else {
        return Ok(());
    };
    let what = format!("the energy of step {step} (processors of different kinds)");
    owned.agree(&what, energy.as_f64().to_bits())
}

/// Refuses an action that needs every model whole on this rank.
pub(super) fn require_whole<T: Real>(subdomains: &[Subdomain<T>], what: &str) -> Result<()> {
    let parted = |s: &&Subdomain<T>| s.owned().is_part();
    subdomains.iter().find(parted).map_or(Ok(()), |s| {
        Err(Error::Unsupported {
            model: s.model().name().to_owned(),
            what: format!("{what} while it is in parts on several ranks; run it on one"),
        })
    })
}
