//! Supports, loads, initial states, functions of time and the fields of frames.

use super::choice::choice;
use super::schema;
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::de::value::MapAccessDeserializer;
use serde::de::{Deserializer, MapAccess, Visitor};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

/// A part of a model: a group by name, or the nodes in a box.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub enum Selection {
    /// Named group.
    Group(String),
    /// Nodes in a closed box: lowest and highest corner \[m\].
    Box([f64; 3], [f64; 3]),
}

/// A selection by its place.
#[derive(Deserialize, JsonSchema)]
#[serde(remote = "Self", deny_unknown_fields, rename_all = "snake_case")]
enum SelectionTable {
    /// Everything in a closed box.
    Box {
        /// Lowest corner \[m\].
        low: [f64; 3],
        /// Highest corner \[m\].
        high: [f64; 3],
    },
}

choice!(SelectionTable, "{ box = { low, high } }");

/// The two forms of a selection in a scene.
#[derive(JsonSchema)]
#[serde(untagged)]
#[allow(dead_code, reason = "read by the schema alone")]
enum SelectionWords {
    /// The name of a group.
    Group(String),
    /// A selection by its place.
    Place(SelectionTable),
}

impl JsonSchema for Selection {
    fn schema_name() -> Cow<'static, str> {
        "Selection".into()
    }
    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        SelectionWords::json_schema(generator)
    }
}

impl<'de> Deserialize<'de> for Selection {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Either;
        impl<'de> Visitor<'de> for Either {
            type Value = Selection;
            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("the name of a group or { box = { low = [x, y, z], high = [x, y, z] } }")
            }
            fn visit_str<E>(self, name: &str) -> Result<Selection, E> {
                Ok(Selection::Group(name.to_owned()))
            }
            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Selection, A::Error> {
                let map_deserializer = MapAccessDeserializer::new(map);
                // The `Deserialize` impl from `choice!` refuses further keys; the derived inherent method of
                // the same name does not.
                let SelectionTable::Box { low, high } =
                    <SelectionTable as Deserialize>::deserialize(map_deserializer)?;
                Ok(Selection::Box(low, high))
            }
        }
        deserializer.deserialize_any(Either)
    }
}

impl std::fmt::Display for Selection {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Group(name) => write!(f, "'{name}'"),
            Self::Box(low, high) => write!(f, "box {low:?} to {high:?}"),
        }
    }
}

/// A coordinate axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Axis {
    /// x.
    X,
    /// y.
    Y,
    /// z.
    Z,
}

impl Axis {
    /// Returns 0, 1 or 2.
    pub fn index(self) -> usize {
        self as usize
    }
}

/// A dimensionless function of time.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, remote = "Self", rename_all = "snake_case")]
#[non_exhaustive]
pub enum TimeShape {
    /// 1 from time zero on.
    Step,
    /// Rises from 0 to 1 within a duration, then stays 1.
    Ramp {
        /// Rise time \[s\].
        #[schemars(extend("exclusiveMinimum" = 0))]
        duration: f64,
    },
    /// `sin²(π t/duration)` within a duration, then 0.
    Pulse {
        /// Duration of the pulse \[s\].
        #[schemars(extend("exclusiveMinimum" = 0))]
        duration: f64,
    },
    /// Linear between `[time, value]` rows of rising times \[s\], constant outside.
    Table(#[schemars(length(min = 1))] Vec<(f64, f64)>),
    /// Reads such rows from a file with comma-separated time \[s\] and value; a first row of words is taken
    /// as headings.
    File(String),
    /// An expression of the time `t` \[s\], such as `"sin(2*pi*50*t)"`.
    Expression(#[schemars(length(min = 1))] String),
}

impl Default for TimeShape {
    /// 1 from time zero on.
    fn default() -> Self {
        Self::Step
    }
}

choice!(
    TimeShape,
    "\"step\", { ramp = { duration = seconds } }, { pulse = { duration = seconds } }, { table = [[time, value], …] }, \
     { file = \"name.csv\" }, { expression = \"sin(2*pi*50*t)\" }"
);

/// `[[support]]`: nodes that are held or moved.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct Support {
    /// Name by which probes read the force and moment; supports with one name count as one. Default:
    /// `support-1`, `support-2`, …
    pub name: Option<String>,
    /// Name of the model. On `body` its zones are held as well, unless a zone has supports of its own.
    pub model: String,
    /// The nodes. If two supports hold a component at rest, it is held once and the first support carries the
    /// force.
    #[serde(rename = "where")]
    pub at: Selection,
    /// The components that are held or moved. Default: all; needed with `motion`, except on lines.
    #[schemars(length(min = 1))]
    pub components: Option<Vec<Axis>>,
    /// Prescribed displacement `amplitude · time`. Default: fixed.
    pub motion: Option<Motion>,
}

/// A prescribed motion.
#[derive(Debug, Clone, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(transform = schema::exactly_one("amplitude speed"))]
#[non_exhaustive]
pub struct Motion {
    /// Displacement `amplitude · time` \[m\] of each of the `components`; exactly one of `amplitude` and
    /// `speed`.
    pub amplitude: Option<f64>,
    /// Speed `speed · time` \[m/s\]: the displacement is its integral.
    pub speed: Option<f64>,
    /// Function of time; 1 from time zero on by default, which for a speed means a constant speed.
    #[serde(default)]
    pub time: TimeShape,
}

/// `[[load]]`: forces on a surface.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(transform = schema::exactly_one("traction force pressure torque"))]
#[schemars(extend("dependencies" = { "follow": ["pressure"] }))]
#[non_exhaustive]
pub struct Load {
    /// Name of the ledger line. Default: `load-1`, `load-2`, …
    #[schemars(extend("pattern" = schema::HEADLINE))]
    pub name: Option<String>,
    /// Name of the model.
    pub model: String,
    /// The surface; a box selects the surface facets with all corners in it, and of particles
    /// the part of the surface in it, without strips narrower than a sphere. On `body` it is the surface of
    /// the whole body, and its zones carry their share.
    #[serde(rename = "where")]
    pub at: Selection,
    /// Traction \[Pa\]; exactly one of `traction`, `force`, `pressure`, `torque`.
    pub traction: Option<[f64; 3]>,
    /// Total force \[N\], spread evenly over the surface (by mass over chains and particles).
    pub force: Option<[f64; 3]>,
    /// Pressure against the outward normal \[Pa\].
    pub pressure: Option<f64>,
    /// Factor on `traction` or `pressure` by the place: an expression of `x`, `y` and `z` \[m\], such as
    /// `"exp(-(x^2 + y^2)/(1e-3)^2)"` for a spot, and of `t` \[s\] with `profile_samples`. Excludes `force`
    /// and `torque`. Default: 1 everywhere.
    pub profile: Option<String>,
    /// Instants at which a profile with `t` is sampled; needed with `t`.
    pub profile_samples: Option<ProfileSamples>,
    /// Lets the pressure turn with the surface of a solid and grow with its area; otherwise it keeps the
    /// direction and the area that the surface has at rest. Default: false.
    #[serde(default)]
    pub follow: bool,
    /// Total moment about the surface's centroid \[N m\], as tractions `θ × (x − c)` (by mass over
    /// particles).
    #[schemars(transform = schema::not_zero)]
    pub torque: Option<[f64; 3]>,
    /// Function of time.
    pub time: TimeShape,
}

/// Instants at which a profile that changes with time is sampled. It is linear between them and keeps its
/// last value.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct ProfileSamples {
    /// Last instant \[s\]; the first one is 0.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub end: f64,
    /// Number of samples, at equal distances.
    #[schemars(range(min = 2, max = 1000))]
    pub count: usize,
}

/// `[[initial]]`: state of models at time zero.
#[derive(Debug, Clone, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(extend("anyOf" = [
    { "required": ["displacement"] }, { "required": ["velocity"] },
    { "required": ["spin"] }, { "required": ["wave"] },
]))]
#[non_exhaustive]
pub struct Initial {
    /// Names of the models; `body` includes its zones unless another `[[initial]]` names them. Default: all.
    pub models: Option<Vec<String>>,
    /// Displacement \[m\].
    pub displacement: Option<Field>,
    /// Velocity \[m/s\].
    pub velocity: Option<Field>,
    /// A rigid spin.
    pub spin: Option<Spin>,
    /// A travelling pulse: displacement and the velocity that goes with it.
    pub wave: Option<Wave>,
}

/// A rigid spin about a point; it sets velocities and the spins of particles.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct Spin {
    /// Angular velocity \[rad/s\].
    pub rate: [f64; 3],
    /// Point on the axis \[m\].
    #[serde(default)]
    pub centre: [f64; 3],
}

/// A vector field.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, remote = "Self", rename_all = "snake_case")]
#[non_exhaustive]
pub enum Field {
    /// One vector everywhere.
    Uniform([f64; 3]),
    /// One component, a polynomial of one coordinate.
    Polynomial(Polynomial),
}

choice!(
    Field,
    "{ uniform = [x, y, z] }, { polynomial = { component = axis, along = axis, coefficients = [c0, c1, …] } }"
);

/// The polynomial `Σ c_k x^k`.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct Polynomial {
    /// Component of the field.
    pub component: Axis,
    /// Coordinate `x`.
    pub along: Axis,
    /// `c_0, c_1, …` in SI units.
    pub coefficients: Vec<f64>,
}

/// A travelling pulse `A cos²(π (x − centre)/width)` within its width.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct Wave {
    /// Component of the displacement.
    pub component: Axis,
    /// Direction of travel.
    pub along: Axis,
    /// Centre at time zero \[m\].
    pub centre: f64,
    /// Width \[m\].
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub width: f64,
    /// Amplitude \[m\].
    pub amplitude: f64,
    /// Speed \[m/s\], negative towards smaller coordinates. Default: `√(E/ρ)` of each model, or of the
    /// material at each node if there are several (the faster one where two meet).
    pub speed: Option<f64>,
}

/// Fields that a frame may have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum OutputField {
    /// Displacement \[m\].
    Displacement,
    /// Velocity \[m/s\].
    Velocity,
    /// `alpha`, `beta`, `gamma` at the nodes \[–\].
    Weights,
    /// Unweighted strain energy density \[J/m³\] at the centres of elements; at particles the energy of their
    /// bonds.
    EnergyDensity,
    /// Multipliers on the mediators.
    Multipliers,
    /// Stress at the nodes \[Pa\]: `xx, yy, zz, xy, yz, xz`, tension positive.
    Stress,
    /// Strain at the nodes \[–\]: `xx, yy, zz, xy, yz, xz`, tension positive; `xy` is half the change of the
    /// angle.
    Strain,
    /// Equivalent stress of von Mises at the nodes \[Pa\].
    VonMises,
    /// Principal stresses at the nodes \[Pa\], largest first.
    PrincipalStress,
    /// Sum of the contact forces on every particle \[N\].
    ContactForces,
    /// Axial and shear force \[N\] and utilisation (load over strength) of every bond.
    BondForces,
}
