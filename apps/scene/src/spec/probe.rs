//! `[probe.NAME]` and `[curve.NAME]`: values over time, and one value over another.

use super::drive::{Axis, Selection};
use super::schema;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// `[probe.NAME]`: a value over time.
#[derive(Debug, Clone, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(transform = schema::exactly_one("at where of crack"))]
#[schemars(extend(
    "dependencies" = {
        "at": ["model"],
        "where": ["model"],
        "crack": { "required": ["model", "quantity"], "properties": { "quantity": { "const": "energy-release" } } },
        "of": { "required": ["quantity"], "properties": { "quantity": { "enum": ["force", "moment"] } } },
        "about": ["of"],
    },
    "if" = {
        "required": ["quantity"],
        "properties": { "quantity": { "enum": ["von-mises", "energy-release"] } },
    },
    "then" = { "properties": { "component": false } },
    "else" = { "required": ["component"] },
))]
#[non_exhaustive]
pub struct Probe {
    /// Name of the model. With `of`, only forces on this model count; all models by default.
    pub model: Option<String>,
    /// Point at which the model's field is read \[m\]; exactly one of `at`, `where`, `of` and `crack`.
    pub at: Option<[f64; 3]>,
    /// Group or box of nodes over which the mean is taken.
    #[serde(rename = "where")]
    pub over: Option<Selection>,
    /// Name of a support, load, rigid body or effect whose `force` or `moment` on the models is read. Several
    /// with one name are added up, such as the two halves of a support in an overlap.
    pub of: Option<String>,
    /// Front of a crack in a finite or natural element model, for `quantity = "energy-release"`.
    pub crack: Option<Crack>,
    /// Point about which a moment is taken \[m\]; by default the centroid of the nodes that are held or
    /// loaded, or the centre of the rigid body at rest.
    pub about: Option<[f64; 3]>,
    /// Quantity that is read.
    #[serde(default)]
    pub quantity: Quantity,
    /// Component: `"x"`, `"y"`, `"z"`; `"xx"`, `"yy"`, `"zz"`, `"xy"`, `"yz"`, `"xz"` of a stress or strain;
    /// `"1"`, `"2"`, `"3"` of the principal stresses, largest first. The stress of von Mises and the energy
    /// release have none.
    pub component: Option<Component>,
}

/// `[probe.NAME] crack`: a straight front and the domain around it over which the energy release is
/// integrated.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct Crack {
    /// Ends of the part of the front over which the mean is taken \[m\]: from surface to surface, or within
    /// the body.
    pub front: [[f64; 3]; 2],
    /// Direction in which the crack would grow, along its faces; a part along the front is ignored.
    #[schemars(transform = schema::not_zero)]
    pub direction: [f64; 3],
    /// Inner and outer radius of the domain \[m\]. The ring between them must lie in the body, except for the
    /// faces of the crack.
    #[schemars(extend("items" = { "type": "number", "exclusiveMinimum": 0 }))]
    pub radii: [f64; 2],
}

/// Components of vectors, of symmetric tensors and of their principal values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Component {
    /// First component of a vector.
    X,
    /// Second component of a vector.
    Y,
    /// Third component of a vector.
    Z,
    /// Normal component along x.
    Xx,
    /// Normal component along y.
    Yy,
    /// Normal component along z.
    Zz,
    /// Shear in the plane of x and y.
    Xy,
    /// Shear in the plane of y and z.
    Yz,
    /// Shear in the plane of x and z.
    Xz,
    /// Largest principal value.
    #[serde(rename = "1")]
    First,
    /// Middle principal value.
    #[serde(rename = "2")]
    Second,
    /// Smallest principal value.
    #[serde(rename = "3")]
    Third,
}

impl Component {
    const NAMES: [&str; 12] = ["x", "y", "z", "xx", "yy", "zz", "xy", "yz", "xz", "1", "2", "3"];

    /// Returns the name in a scene.
    pub fn name(self) -> &'static str {
        Self::NAMES[self as usize]
    }

    /// Returns the direction if this is a component of a vector.
    pub fn axis(self) -> Option<Axis> {
        match self {
            Self::X => Some(Axis::X),
            Self::Y => Some(Axis::Y),
            Self::Z => Some(Axis::Z),
            _ => None,
        }
    }

    /// Returns the index in `xx, yy, zz, xy, yz, xz` if this is a component of a tensor.
    pub fn tensor(self) -> Option<usize> {
        (self as usize).checked_sub(3).filter(|k| *k < 6)
    }

    /// Returns the index among the principal values, largest first, if this is one of them.
    pub fn rank(self) -> Option<usize> {
        (self as usize).checked_sub(9)
    }
}

/// Quantities that a probe can read.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Quantity {
    /// Displacement \[m\].
    #[default]
    Displacement,
    /// Velocity \[m/s\].
    Velocity,
    /// Mean rotation of a group of nodes about an axis through their centroid \[rad\].
    Rotation,
    /// Force on the models \[N\] of a support, load, rigid body or effect.
    Force,
    /// Moment on the models \[N m\] of a support, load, rigid body or effect, about a point.
    Moment,
    /// Stress \[Pa\], recovered at the nodes; tension positive. For particles the stress of their bonds.
    Stress,
    /// Strain \[–\], recovered at the nodes; `xy` is half the change of the angle. Particles have none.
    Strain,
    /// Equivalent stress of von Mises \[Pa\].
    VonMises,
    /// A principal stress \[Pa\].
    PrincipalStress,
    /// Energy that a crack releases per area as it grows, J \[J/m²\]: an integral over a domain around the
    /// crack front.
    EnergyRelease,
}

/// Source from which the value of a quantity is computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Reading {
    /// Displacements of nodes.
    Displacements,
    /// Velocities of nodes.
    Velocities,
    /// Force on the models.
    Force,
    /// Moment on the models.
    Moment,
    /// A tensor that is recovered at nodes.
    Tensor,
    /// Integral over a domain around a crack front.
    Release,
}

impl Quantity {
    /// Returns what the value is computed from.
    pub(crate) fn reading(self) -> Reading {
        match self {
            Self::Displacement | Self::Rotation => Reading::Displacements,
            Self::Velocity => Reading::Velocities,
            Self::Force => Reading::Force,
            Self::Moment => Reading::Moment,
            Self::Stress | Self::Strain | Self::VonMises | Self::PrincipalStress => Reading::Tensor,
            Self::EnergyRelease => Reading::Release,
        }
    }

    /// Returns name and unit.
    pub fn label(self) -> &'static str {
        match self {
            Self::Displacement => "displacement [m]",
            Self::Velocity => "velocity [m/s]",
            Self::Rotation => "rotation [rad]",
            Self::Force => "force [N]",
            Self::Moment => "moment [N m]",
            Self::Stress => "stress [Pa]",
            Self::Strain => "strain [-]",
            Self::VonMises => "von Mises stress [Pa]",
            Self::PrincipalStress => "principal stress [Pa]",
            Self::EnergyRelease => "energy release [J/m2]",
        }
    }
}

/// `[curve.NAME]`: one probe over another, such as force over displacement.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct Curve {
    /// Probe on the horizontal axis.
    pub x: String,
    /// Probe on the vertical axis.
    pub y: String,
    /// Factor on the values of `x`; -1 changes the sign.
    #[serde(default = "unit_factor")]
    pub x_factor: f64,
    /// Factor on the values of `y`; -1 changes the sign, such as to plot a reaction as a load.
    #[serde(default = "unit_factor")]
    pub y_factor: f64,
}

fn unit_factor() -> f64 {
    1.0
}
