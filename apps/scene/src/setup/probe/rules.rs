//! Rules of `[probe.NAME]` that a scene shows without its models.

use crate::error::{Result, key, value};
use crate::spec::{Axis, Component, Probe, Quantity};

/// Direction that a probe of a vector must name.
pub(in crate::setup) fn axis(path: &str, probe: &Probe) -> Result<Axis> {
    let rule = "one of \"x\", \"y\", \"z\"";
    let key_path = format!("{path}.component");
    match probe.component {
        None => Err(key(key_path, format!("is needed: {rule}"))),
        Some(c) => c
            .axis()
            .ok_or_else(|| value(key_path, c.name(), &format!("is no direction; take {rule}"))),
    }
}

pub(super) const ONE_PLACE: &str = "needs exactly one of at, where, of, crack";

/// Model that a probe of motion must name.
pub(in crate::setup) fn model<'a>(path: &str, probe: &'a Probe) -> Result<&'a str> {
    let missing = || {
        let rule = "is needed: the name of the model that is looked at";
        key(format!("{path}.model"), rule)
    };
    probe.model.as_deref().ok_or_else(missing)
}

/// Refuses a probe that does not name exactly one place, or whose other keys do not fit its quantity.
pub(in crate::setup) fn check(path: &str, probe: &Probe) -> Result<()> {
    if matches!(probe.quantity, Quantity::Force | Quantity::Moment) {
        let rule = "is what something exerts on the models; name it with of = \"…\" in place of at and where";
        return Err(key(format!("{path}.quantity"), rule));
    }
    check_quantity(path, probe)?;
    check_component(path, probe.quantity, probe.component)?;
    if probe.about.is_some() {
        let rule = "is the point of a moment; remove it";
        return Err(key(format!("{path}.about"), rule));
    }
    match (&probe.at, &probe.over) {
        (None, None) if probe.crack.is_some() => Ok(()),
        (Some(_), None) if probe.crack.is_none() && probe.quantity == Quantity::Rotation => Err(key(
            format!("{path}.at"),
            "a rotation is that of a group of nodes; give where",
        )),
        (Some(_), None) | (None, Some(_)) if probe.crack.is_none() => Ok(()),
        _ => Err(key(path, ONE_PLACE)),
    }
}

/// Refuses a component that a quantity does not have.
fn check_component(path: &str, quantity: Quantity, component: Option<Component>) -> Result<()> {
    let key_path = || format!("{path}.component");
    let (fits, requirement): (fn(Component) -> bool, _) = match quantity {
        Quantity::Stress | Quantity::Strain => (
            |c| c.tensor().is_some(),
            "a stress or strain has \"xx\", \"yy\", \"zz\", \"xy\", \"yz\", \"xz\"",
        ),
        Quantity::PrincipalStress => (
            |c| c.rank().is_some(),
            "principal stresses are \"1\", the largest, \"2\" and \"3\"",
        ),
        Quantity::VonMises => {
            return match component {
                None => Ok(()),
                Some(c) => Err(value(
                    key_path(),
                    c.name(),
                    "is none of the stress of von Mises; remove it",
                )),
            };
        }
        // These name a direction, or have no component; both are checked elsewhere.
        Quantity::Displacement
        | Quantity::Velocity
        | Quantity::Rotation
        | Quantity::Force
        | Quantity::Moment
        | Quantity::EnergyRelease => return Ok(()),
    };
    match component {
        Some(c) if fits(c) => Ok(()),
        Some(c) => Err(value(key_path(), c.name(), requirement)),
        None => Err(key(key_path(), format!("is needed: {requirement}"))),
    }
}

/// Refuses a crack with another quantity than the energy release rate, and this quantity without a crack.
fn check_quantity(path: &str, probe: &Probe) -> Result<()> {
    match (&probe.crack, probe.quantity) {
        (Some(_), Quantity::EnergyRelease) => match probe.component {
            None => Ok(()),
            Some(c) => {
                let rule = "is none of the energy that a crack releases; remove it";
                Err(value(format!("{path}.component"), c.name(), rule))
            }
        },
        (Some(_), _) => {
            let rule = "is looked at with quantity = \"energy-release\"; name it, or remove crack";
            Err(key(format!("{path}.crack"), rule))
        }
        (None, Quantity::EnergyRelease) => {
            let rule = "is that of a crack; give crack = { front = [[…], […]], direction = […], radii = […] } in place of at and where";
            Err(key(format!("{path}.quantity"), rule))
        }
        (None, _) => Ok(()),
    }
}
