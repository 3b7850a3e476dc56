//! `[[effect]]`: what acts on the models beside supports and loads.

use super::choice::choice;
use super::drive::TimeShape;
use super::schema;
use schemars::JsonSchema;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer};

/// `[[effect]]`.
#[derive(Debug, Clone)]
pub struct Effect {
    /// On which models; all that can have it by default.
    pub models: Option<Vec<String>>,
    /// The two models a contact is between; in place of `models`.
    pub between: Option<Vec<String>>,
    /// `false`: as if it were not listed; the strengths of `fracture` are then compared at the end only,
    /// for a warning.
    pub enabled: bool,
    /// The effect itself.
    pub kind: EffectKind,
}

/// Models that can have an effect.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Bearer {
    /// Any.
    Any,
    /// Solids of finite or natural elements.
    Solids,
    /// Particles.
    Particles,
}

/// One line per effect: its key in a scene, its type, the models that can have it.
macro_rules! effects {
    ($($(#[$doc:meta])* $key:ident: $kind:ident, $bearer:ident;)*) => {
        /// The effects of scenes.
        #[derive(Debug, Clone)]
        #[allow(clippy::large_enum_variant, reason = "a scene has few effects")]
        pub enum EffectKind {
            $($(#[$doc])* $kind($kind),)*
        }

        impl EffectKind {
            const KEYS: &[&str] = &[$(stringify!($key)),*];

            /// Its key in a scene.
            pub fn key(&self) -> &'static str {
                match self { $(Self::$kind(_) => stringify!($key),)* }
            }

            /// Models that can have it.
            pub fn bearer(&self) -> Bearer {
                match self { $(Self::$kind(_) => Bearer::$bearer,)* }
            }
        }

        /// Exactly one effect, and on what it acts.
        #[derive(Deserialize, JsonSchema)]
        #[serde(deny_unknown_fields)]
        #[schemars(rename = "Effect", transform = schema::exactly_one(EffectKind::KEYS.join(" ")))]
        pub(super) struct Table {
            /// On which models. Default: all that can have it.
            models: Option<Vec<String>>,
            /// For `contact`, in place of `models`: the two particle models whose particles touch each
            /// other. Default: within each model.
            between: Option<Vec<String>>,
            /// `false`: as if it were not listed; the strengths of `fracture` are then compared at the end
            /// only, for a warning.
            #[serde(default = "yes")]
            enabled: bool,
            $($(#[$doc])* $key: Option<$kind>,)*
        }

        impl Table {
            /// The effect, if exactly one is given.
            fn effect(self) -> Option<Effect> {
                let given = [$(self.$key.map(EffectKind::$kind)),*];
                let mut given = given.into_iter().flatten();
                let (Some(kind), None) = (given.next(), given.next()) else { return None };
                Some(Effect { models: self.models, between: self.between, enabled: self.enabled, kind })
            }
        }
    };
}

effects! {
    /// Body force.
    body_force: BodyForce, Any;
    /// Mass-proportional damping.
    mass_damping: MassDamping, Any;
    /// Stiffness-proportional damping.
    stiffness_damping: StiffnessDamping, Any;
    /// Local damping.
    local_damping: LocalDamping, Any;
    /// Bulk viscosity.
    bulk_viscosity: BulkViscosity, Solids;
    /// Initial displacements count as equilibrium.
    prestress: Prestress, Any;
    /// Bonds that break.
    fracture: Fracture, Particles;
    /// Contact between unbonded particles.
    contact: Contact, Particles;
    /// A rigid body.
    obstacle: Obstacle, Particles;
}

fn yes() -> bool {
    true
}

/// Reads all `[[effect]]`.
pub(super) fn effects<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<Effect>, D::Error> {
    let tables = Vec::<Table>::deserialize(deserializer)?;
    let one = |(k, table): (usize, Table)| {
        let keys = EffectKind::KEYS.join(", ");
        let wrong = || D::Error::custom(format!("effect[{k}]: needs exactly one of {keys}"));
        table.effect().ok_or_else(wrong)
    };
    tables.into_iter().enumerate().map(one).collect()
}

/// A constant acceleration field.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BodyForce {
    /// Acceleration \[m/s²\].
    pub acceleration: [f64; 3],
    /// Time function; from time zero on by default.
    #[serde(default)]
    pub time: TimeShape,
}

/// Mass-proportional damping.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MassDamping {
    /// Rate \[1/s\] of the damping force `rate · mass · velocity`; lowers the critical step.
    pub rate: f64,
}

/// Initial displacements count as equilibrium; nothing to choose.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Prestress {}

/// Stiffness-proportional damping.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StiffnessDamping {
    /// Time \[s\] of the damping force `time · K · velocity`, which damps a mode of frequency `ω` by `time
    /// ω/2`; lowers the critical step.
    pub time: f64,
}

/// Local damping.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LocalDamping {
    /// Share of its force that every unknown feels against its motion, 0 to below 1 \[–\].
    pub share: f64,
}

/// Linear bulk viscosity.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BulkViscosity {
    /// Coefficient `b` of the pressure `−b ρ c L div v` in the cells of solids \[–\]; lowers the critical
    /// step.
    #[serde(default = "usual")]
    pub coefficient: f64,
}

fn usual() -> f64 {
    0.06
}

/// Bonds that break.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(transform = schema::at_most_one("weibull deviation"))]
pub struct Fracture {
    /// What is compared with the strength.
    pub criterion: CriterionKind,
    /// Strength of the beams (not of the packing) \[Pa\], or \[J/m²\] for the energy; the characteristic
    /// one with `weibull`, else the mean.
    pub strength: f64,
    /// Weibull modulus of the scatter between bonds \[–\]. Default: no scatter.
    pub weibull: Option<f64>,
    /// Relative deviation of a normal scatter, below 1/3 \[–\]; in place of `weibull`. Default: no scatter.
    pub deviation: Option<f64>,
    /// Seed of the scatter; strengths belong to places, whatever the numbering.
    #[serde(default = "one")]
    pub seed: u64,
    /// Steps between two checks. Default: 1.
    pub every: Option<usize>,
    /// Whether bonds that lie in an overlap, wholly or in part, never break. No cure for a crack that
    /// reaches the overlap: what cannot break carries more load than the body has strength.
    #[serde(default)]
    pub spare_overlap: bool,
    /// Whether the run ends when a crack runs into an overlap, six broken bonds there that are near each
    /// other or joined by others, with `status` `"stopped-at-overlap"` and all results; `arlequin resume`
    /// goes on.
    #[serde(default)]
    pub stop_at_overlap: bool,
}

fn one() -> u64 {
    1
}

/// Criteria of bonds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum CriterionKind {
    /// Axial tension.
    Axial,
    /// Largest principal tension of the section.
    Rankine,
    /// Equivalent stress of von Mises.
    Mises,
    /// Elastic energy per section.
    Energy,
}

/// Contact between unbonded particles.
#[derive(Debug, Clone, Copy, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Contact {
    /// Modulus `E` of the normal spring `2 E r_i r_j/(r_i + r_j)` between particles that no bond joins
    /// \[Pa\]. Default: `material.young`; `2 E F/(E + F)` of both with `between`.
    pub modulus: Option<f64>,
    /// Coefficient of restitution, 0.15 to 1 \[–\]. Default: 0.5.
    pub restitution: Option<f64>,
    /// Coulomb friction \[–\]. Default: 0.
    pub friction: Option<f64>,
    /// Tangential over normal stiffness \[–\]. Default: 0.5.
    pub shear_ratio: Option<f64>,
    /// Rolling resistance, lever over reduced radius \[–\]; not of obstacles. Default: 0.
    pub rolling: Option<f64>,
    /// Reach of the neighbour list beyond touch, in mean radii \[–\]; not of obstacles. Default: 0.4.
    pub skin: Option<f64>,
}

/// A rigid body.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(transform = schema::at_most_one("velocity displacement"))]
pub struct Obstacle {
    /// Line in the ledger. Default: `obstacle-1`, …
    pub name: Option<String>,
    /// Shape at rest.
    pub shape: ObstacleShape,
    /// Constant velocity \[m/s\]; with `mass` the one at the start. Default: at rest.
    pub velocity: Option<[f64; 3]>,
    /// Prescribed displacement, in place of `velocity`.
    pub displacement: Option<ObstacleMotion>,
    /// Mass of a free body \[kg\], on which each `body_force` of its particles acts as well; a free sphere
    /// also turns, by the friction of `contact`, planes and cylinders do not. Default: driven or fixed.
    pub mass: Option<f64>,
    /// Moment of inertia of a free sphere \[kg m²\]. Default: full ball, `2/5 mass radius²`.
    pub inertia: Option<f64>,
    /// Angular velocity of a free sphere at the start \[rad/s\]. Default: none.
    pub spin: Option<[f64; 3]>,
    /// How it touches particles.
    #[serde(default)]
    pub contact: Contact,
}

/// Shapes of obstacles.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, remote = "Self", rename_all = "snake_case")]
pub enum ObstacleShape {
    /// Half-space behind a plane.
    Plane {
        /// A point of it \[m\].
        point: [f64; 3],
        /// Normal, towards the particles.
        normal: [f64; 3],
    },
    /// Ball.
    Sphere {
        /// Centre \[m\].
        centre: [f64; 3],
        /// Radius \[m\].
        radius: f64,
    },
    /// Endless cylinder.
    Cylinder {
        /// A point of the axis \[m\].
        point: [f64; 3],
        /// Direction of the axis.
        axis: [f64; 3],
        /// Radius \[m\].
        radius: f64,
    },
}

choice!(
    ObstacleShape,
    "{ plane = { point, normal } }, { sphere = { centre, radius } }, { cylinder = { point, axis, radius } }"
);

/// Displacement of an obstacle, `amplitude · time`.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ObstacleMotion {
    /// Amplitude \[m\].
    pub amplitude: [f64; 3],
    /// Time function.
    pub time: TimeShape,
}
