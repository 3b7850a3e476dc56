//! What a run asks of models that are in parts on several ranks.

use crate::effect::PairSpec;
use crate::interface::InterfaceSpec;
use crate::subdomain::{OwnStep, Subdomain};
use crate::{Error, Real, Result};

/// Refuses what models in parts cannot do.
pub(super) fn check<T: Real>(
    subdomains: &[Subdomain<T>],
    interfaces: &[InterfaceSpec<T>],
    pairs: &[PairSpec<T>],
) -> Result<()> {
    for (k, s) in subdomains.iter().enumerate() {
        let Some(portion) = s.portion() else {
            continue;
        };
        let tied = interfaces.iter().find(|i| [i.coarse, i.fine].contains(&k));
        let why = if let Some(i) = tied {
            format!("be tied by interface '{}'", i.name)
        } else if pairs.iter().any(|p| p.sides.contains(&k)) {
            "touch another model".to_owned()
        } else if s.has_effects() {
            "have effects".to_owned()
        } else if s.moving().next().is_some() {
            "have supports that move".to_owned()
        } else if s.step_choice() == OwnStep::Implicit {
            "step implicitly".to_owned()
        } else {
            continue;
        };
        let ranks = portion.division().ranks();
        return Err(Error::Unsupported {
            model: s.model().name().to_owned(),
            what: format!("{why} while it is in parts on {ranks} ranks; run it on one"),
        });
    }
    Ok(())
}

/// Whether ranks still hear of each other.
pub(super) fn heard<T: Real>(subdomains: &[Subdomain<T>]) -> Result<()> {
    let mut failures = subdomains.iter().filter_map(|s| s.portion()?.failure());
    failures.next().map_or(Ok(()), |e| Err(e.clone().into()))
}

/// Refuses to do what needs all of every model here.
pub(super) fn whole<T: Real>(subdomains: &[Subdomain<T>], what: &str) -> Result<()> {
    let parted = |s: &&Subdomain<T>| s.portion().is_some();
    subdomains.iter().find(parted).map_or(Ok(()), |s| {
        Err(Error::Unsupported {
            model: s.model().name().to_owned(),
            what: format!("{what} while it is in parts on several ranks; run it on one"),
        })
    })
}
