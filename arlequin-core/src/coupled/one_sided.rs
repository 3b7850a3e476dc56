//! Effects that act on the whole of a body, but on one model of an overlap only.

use crate::Real;
use crate::interface::Interface;
use crate::subdomain::Subdomain;

/// Says which effects on the share of one model lack their counterpart on the other model of an interface.
pub(super) fn warnings<T: Real>(interface: &Interface<T>, subdomains: &[Subdomain<T>]) -> Vec<String> {
    let sides = interface.sides.map(|k| &subdomains[k]);
    // What acts within a solver of its own is not known.
    if sides.iter().any(|s| s.is_guest()) {
        return Vec::new();
    }
    let [coarse, fine] = sides.map(|s| -> Vec<&str> {
        let bulk = s.effects().filter(|e| e.acts_on_shares());
        bulk.map(|e| e.name()).collect()
    });
    let [first, second] = sides.map(|s| s.model().name());
    let mut out = Vec::new();
    for (here, there, with, without) in [(&coarse, &fine, first, second), (&fine, &coarse, second, first)] {
        for name in here.iter().filter(|n| !there.contains(n)) {
            out.push(format!(
                "'{with}' has the effect '{name}', '{without}' has it not: in the overlap it acts on the share of '{with}' alone, which \
                 grows from nothing to all of the body across it; give both models the same, or none"
            ));
        }
    }
    out
}
