//! Warnings of effects that act on a whole body but were given to only one model of an overlap.

use crate::Real;
use crate::interface::Interface;
use crate::subdomain::Subdomain;

/// Returns a warning for each effect on the share of one model of an interface that the other model lacks.
pub(super) fn warnings<T: Real>(interface: &Interface<T>, subdomains: &[Subdomain<T>]) -> Vec<String> {
    let sides = interface.sides.map(|k| &subdomains[k]);
    // Effects within an external solver are not known.
    if sides.iter().any(|s| s.is_external()) {
        return Vec::new();
    }
    let [coarse, fine] = sides.map(|s| -> Vec<&str> {
        let bulk = s.effects().filter(|e| e.acts_on_shares());
        bulk.map(|e| e.name()).collect()
    });
    let [first, second] = sides.map(|s| s.model().name());
    let mut out = Vec::new();
    for (names, partner_names, with, without) in
        [(&coarse, &fine, first, second), (&fine, &coarse, second, first)]
    {
        for name in names.iter().filter(|n| !partner_names.contains(n)) {
            out.push(format!(
                "'{with}' has the effect '{name}', '{without}' has it not: in the overlap it acts on the share of '{with}' alone, which \
                 grows from nothing to all of the body across it; give both models the same, or none"
            ));
        }
    }
    out
}
