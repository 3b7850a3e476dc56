//! What acts on the models and what is watched: supports, loads, effects, initial states, probes.

use super::choice::choice;
use super::schema;
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::de::value::MapAccessDeserializer;
use serde::de::{Deserializer, MapAccess, Visitor};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

/// A part of a model: a group by name, or what lies in a box.
#[derive(Debug, Clone)]
pub enum Selection {
    /// Named group.
    Group(String),
    /// Nodes in a closed box: lowest and highest corner \[m\].
    Box([f64; 3], [f64; 3]),
}

/// A selection by place.
#[derive(Deserialize, JsonSchema)]
#[serde(remote = "Self", deny_unknown_fields, rename_all = "snake_case")]
enum SelectionTable {
    /// What lies in a closed box.
    Box {
        /// Lowest corner \[m\].
        low: [f64; 3],
        /// Highest corner \[m\].
        high: [f64; 3],
    },
}

choice!(SelectionTable, "{ box = { low, high } }");

/// What the text of a selection may be.
#[derive(JsonSchema)]
#[serde(untagged)]
#[allow(dead_code, reason = "read by the schema alone")]
enum SelectionWords {
    /// The name of a group.
    Group(String),
    /// A place.
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
                let of_map = MapAccessDeserializer::new(map);
                // The one of the choice, which minds further keys, not the derived one of the same name.
                let SelectionTable::Box { low, high } = <SelectionTable as Deserialize>::deserialize(of_map)?;
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

/// Directions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Axis {
    /// First.
    X,
    /// Second.
    Y,
    /// Third.
    Z,
}

impl Axis {
    /// 0, 1, 2.
    pub fn index(self) -> usize {
        self as usize
    }
}

/// A dimensionless function of time.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, remote = "Self", rename_all = "snake_case")]
pub enum TimeShape {
    /// One from time zero on.
    Step,
    /// From 0 to 1 within a duration, then 1.
    Ramp {
        /// Rise time \[s\].
        duration: f64,
    },
    /// `sin²(π t/duration)` within a duration, then 0.
    Pulse {
        /// Length \[s\].
        duration: f64,
    },
    /// Linear between `[time, value]` rows of rising times \[s\], constant outside.
    Table(Vec<(f64, f64)>),
    /// The same from a file with comma-separated rows of time \[s\] and value; a first row of words is a
    /// headline.
    File(String),
    /// An expression of the time `t` \[s\], such as `"sin(2*pi*50*t)"`.
    Expression(String),
}

impl Default for TimeShape {
    /// From time zero on.
    fn default() -> Self {
        Self::Step
    }
}

choice!(
    TimeShape,
    "\"step\", { ramp = { duration = seconds } }, { pulse = { duration = seconds } }, { table = [[time, value], …] }, \
     { file = \"name.csv\" }, { expression = \"sin(2*pi*50*t)\" }"
);

/// `[[support]]`.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Support {
    /// Name by which probes ask for its force and moment; `support-1`, `support-2`, … by default. Supports
    /// of one name count as one.
    pub name: Option<String>,
    /// Model; on `body` its zones are held as well, where they have no support of their own.
    pub model: String,
    /// Which nodes. Components that two supports hold at rest are held once, and their force is that of the
    /// first.
    #[serde(rename = "where")]
    pub at: Selection,
    /// Which components. Default: all.
    pub components: Option<Vec<Axis>>,
    /// Prescribed displacement `amplitude · time`. Default: fixed.
    pub motion: Option<Motion>,
}

/// A prescribed motion.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(transform = schema::exactly_one("amplitude speed"))]
pub struct Motion {
    /// Displacement `amplitude · time` \[m\]; exactly one of `amplitude` and `speed`.
    pub amplitude: Option<f64>,
    /// Speed `speed · time` \[m/s\]: the displacement is its integral.
    pub speed: Option<f64>,
    /// Time function; from time zero on by default, which for a speed is a constant one.
    #[serde(default)]
    pub time: TimeShape,
}

/// `[[load]]`.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(transform = schema::exactly_one("traction force pressure torque"))]
pub struct Load {
    /// Line in the ledger. Default: `load-1`, `load-2`, …
    pub name: Option<String>,
    /// Model.
    pub model: String,
    /// Which surface; a box selects the surface facets with all corners in it. On `body` the surface of the
    /// whole body: its zones carry their share.
    #[serde(rename = "where")]
    pub at: Selection,
    /// Traction \[Pa\]; exactly one of `traction`, `force`, `pressure`, `torque`.
    pub traction: Option<[f64; 3]>,
    /// Total force \[N\], spread evenly over the surface (by mass over chains and particles).
    pub force: Option<[f64; 3]>,
    /// Pressure against the outward normal \[Pa\].
    pub pressure: Option<f64>,
    /// Total moment about the surface's centroid \[N m\], as tractions `θ × (x − c)` (by mass over
    /// particles).
    pub torque: Option<[f64; 3]>,
    /// Time function.
    pub time: TimeShape,
}

/// `[[initial]]`.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Initial {
    /// Of which models; with `body` its zones, but those that another one names. Default: all.
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

/// A rigid spin about a point: velocities, and spins of particles.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Spin {
    /// Angular velocity \[rad/s\].
    pub rate: [f64; 3],
    /// Point on its axis \[m\].
    #[serde(default)]
    pub centre: [f64; 3],
}

/// A vector field.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, remote = "Self", rename_all = "snake_case")]
pub enum Field {
    /// The same everywhere.
    Uniform([f64; 3]),
    /// One component, a polynomial of one coordinate.
    Polynomial(Polynomial),
}

choice!(
    Field,
    "{ uniform = [x, y, z] }, { polynomial = { component = axis, along = axis, coefficients = [c0, c1, …] } }"
);

/// `Σ c_k x^k`.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Polynomial {
    /// Component of the field.
    pub component: Axis,
    /// Coordinate.
    pub along: Axis,
    /// `c_0, c_1, …` in SI units.
    pub coefficients: Vec<f64>,
}

/// `A cos²(π (x − centre)/width)` within its width, travelling.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Wave {
    /// Component of the displacement.
    pub component: Axis,
    /// Direction of travel.
    pub along: Axis,
    /// Centre at time zero \[m\].
    pub centre: f64,
    /// Width \[m\].
    pub width: f64,
    /// Amplitude \[m\].
    pub amplitude: f64,
    /// Speed, negative towards smaller coordinates \[m/s\]. Default: `√(E/ρ)` of each model, of the
    /// material at each node where it has several (the faster one where two meet).
    pub speed: Option<f64>,
}

/// Fields of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum OutputField {
    /// Displacement \[m\].
    Displacement,
    /// Velocity \[m/s\].
    Velocity,
    /// `alpha`, `beta`, `gamma` at the nodes \[–\].
    Weights,
    /// Unweighted strain energy density \[J/m³\] at the centres of elements, and at particles: the energy
    /// of their bonds.
    EnergyDensity,
    /// Multipliers on the mediators.
    Multipliers,
    /// Stress at the nodes \[Pa\]: `xx, yy, zz, xy, yz, xz`, tension positive.
    Stress,
    /// Strain at the nodes \[–\], likewise; `xy` is half the change of the angle.
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
