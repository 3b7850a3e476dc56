//! `[[effect]]`: physics of the models besides supports and loads.

use super::choice::choice;
use super::drive::TimeShape;
use super::schema;
use schemars::JsonSchema;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer};
use std::path::PathBuf;

/// `[[effect]]`: one effect and the models that have it.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Effect {
    /// Names of the models. Default: all that can have the effect.
    pub models: Option<Vec<String>>,
    /// The two models of a contact between models; excludes `models`.
    pub between: Option<Vec<String>>,
    /// False to leave the effect out. A `fracture` that is left out still warns at the end if strengths were
    /// exceeded.
    pub enabled: bool,
    /// The effect with its settings.
    pub kind: EffectKind,
}

/// Kinds of models that can have an effect.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Bearer {
    /// All models.
    Any,
    /// Solids of finite or natural elements.
    Solids,
    /// Models of particles.
    Particles,
    /// Models of particles; solids of finite or natural elements where the scene names them.
    Surfaces,
}

impl Bearer {
    /// Returns whether the effect lets bodies break or touch.
    pub(crate) fn touches(self) -> bool {
        matches!(self, Self::Particles | Self::Surfaces)
    }
}

/// Declares the effects, one per line: key in a scene, type, and the models that can have it.
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

            /// Returns the key in a scene.
            pub fn key(&self) -> &'static str {
                match self { $(Self::$kind(_) => stringify!($key),)* }
            }

            /// Returns the kinds of models that can have the effect.
            pub fn bearer(&self) -> Bearer {
                match self { $(Self::$kind(_) => Bearer::$bearer,)* }
            }
        }

        /// Exactly one effect, and the models that have it.
        #[derive(Deserialize, JsonSchema)]
        #[serde(deny_unknown_fields)]
        #[schemars(rename = "Effect", transform = schema::exactly_one(EffectKind::KEYS.join(" ")))]
        #[schemars(transform = schema::excludes("between", "models"))]
        #[schemars(extend("dependencies" = { "between": ["contact"] }))]
        pub(super) struct Table {
            /// Names of the models. Default: all that can have the effect; for `obstacle` the models of
            /// particles, or all solids if there are none.
            #[schemars(length(min = 1))]
            models: Option<Vec<String>>,
            /// For `contact`, instead of `models`: two models that touch each other, particles or solids of
            /// elements; zones of a body are named on their own. Default: contact within each model of
            /// particles.
            #[schemars(length(equal = 2))]
            between: Option<Vec<String>>,
            /// False to leave the effect out. A `fracture` that is left out still warns at the end if
            /// strengths were exceeded.
            #[serde(default = "enabled")]
            enabled: bool,
            $($(#[$doc])* $key: Option<$kind>,)*
        }

        impl Table {
            /// Returns the effect if exactly one is given.
            fn effect(self) -> Option<Effect> {
                let effects = [$(self.$key.map(EffectKind::$kind)),*];
                let mut effects = effects.into_iter().flatten();
                let (Some(kind), None) = (effects.next(), effects.next()) else { return None };
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
    /// Takes the initial displacements as equilibrium.
    prestress: Prestress, Any;
    /// Bonds that break.
    fracture: Fracture, Particles;
    /// Contact between unbonded particles, or between two models.
    contact: Contact, Particles;
    /// A rigid body that particles and surfaces touch.
    obstacle: Obstacle, Surfaces;
}

impl Effect {
    /// Returns the name of effect `k` in the ledger; `None` for fracture, which exerts no force.
    pub(crate) fn ledger_name(&self, k: usize) -> Option<String> {
        match (&self.kind, &self.between) {
            (EffectKind::Fracture(_), _) => None,
            (EffectKind::Obstacle(o), _) => Some(o.ledger_name(k)),
            (_, Some(between)) => Some(format!("contact {}", between.join("-"))),
            (_, None) => Some(self.kind.key().replace('_', "-")),
        }
    }
}

impl EffectKind {
    /// Returns whether the effect works on a model that is partitioned among ranks.
    pub(crate) fn works_in_parts(&self) -> bool {
        match self {
            Self::BodyForce(_)
            | Self::MassDamping(_)
            | Self::StiffnessDamping(_)
            | Self::LocalDamping(_)
            | Self::Prestress(_)
            | Self::Fracture(_)
            | Self::Contact(_)
            | Self::Obstacle(_) => true,
            Self::BulkViscosity(_) => false,
        }
    }

    /// Returns the function of time among the settings, with its key.
    pub(crate) fn time_mut(&mut self) -> Option<(&'static str, &mut TimeShape)> {
        match self {
            Self::BodyForce(b) => Some(("time", &mut b.time)),
            Self::Obstacle(o) => o
                .displacement
                .as_mut()
                .map(|m| ("displacement.time", &mut m.time)),
            Self::MassDamping(_)
            | Self::StiffnessDamping(_)
            | Self::LocalDamping(_)
            | Self::BulkViscosity(_)
            | Self::Prestress(_)
            | Self::Fracture(_)
            | Self::Contact(_) => None,
        }
    }
}

fn enabled() -> bool {
    true
}

/// Reads all `[[effect]]` tables.
pub(super) fn effects<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<Effect>, D::Error> {
    let tables = Vec::<Table>::deserialize(deserializer)?;
    let to_effect = |(k, table): (usize, Table)| {
        let keys = EffectKind::KEYS.join(", ");
        let wrong = || D::Error::custom(format!("effect[{k}]: needs exactly one of {keys}"));
        table.effect().ok_or_else(wrong)
    };
    tables.into_iter().enumerate().map(to_effect).collect()
}

/// A constant acceleration field.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct BodyForce {
    /// Acceleration \[m/s²\].
    pub acceleration: [f64; 3],
    /// Function of time; 1 from time zero on by default.
    #[serde(default)]
    pub time: TimeShape,
}

/// Mass-proportional damping.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct MassDamping {
    /// Rate \[1/s\] of the damping force `rate · mass · velocity`; lowers the critical step.
    #[schemars(range(min = 0))]
    pub rate: f64,
}

/// Takes the initial displacements as equilibrium; has no settings.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct Prestress {}

/// Stiffness-proportional damping.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct StiffnessDamping {
    /// Time \[s\] in the damping force `time · K · velocity`, which damps a mode of frequency `ω` by `time
    /// ω/2`; lowers the critical step.
    #[schemars(range(min = 0))]
    pub time: f64,
}

/// Local damping.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct LocalDamping {
    /// Share of the force on each unknown that acts against its motion, 0 to below 1 \[–\].
    #[schemars(extend("minimum" = 0, "exclusiveMaximum" = 1))]
    pub share: f64,
}

/// Linear bulk viscosity.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct BulkViscosity {
    /// Coefficient `b` of the pressure `−b ρ c L div v` in the cells of solids \[–\]; lowers the critical
    /// step.
    #[serde(default = "usual_coefficient")]
    #[schemars(range(min = 0))]
    pub coefficient: f64,
}

impl Default for BulkViscosity {
    fn default() -> Self {
        Self {
            coefficient: usual_coefficient(),
        }
    }
}

fn usual_coefficient() -> f64 {
    0.06
}

/// Bonds that break.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(transform = schema::excludes("weibull", "deviation"), transform = schema::fracture_keys)]
#[non_exhaustive]
pub struct Fracture {
    /// Measure that is compared with the strength; excludes `softening`. Default: `tensile-energy` with `gc`;
    /// needed with `strength`.
    pub criterion: Option<CriterionKind>,
    /// Fracture energy of the body \[J/m²\]: what a crack takes per area that it opens. Sets the strength of
    /// the beams; for `energy` and `tensile-energy`; excludes `strength` except with `softening`.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub gc: Option<f64>,
    /// Strength of the beams (not of the packing) \[Pa\]; for `energy` and `tensile-energy` \[J/m²\], for
    /// `hydrostatic` of the particles \[Pa\]. With `weibull` the characteristic strength, else the mean.
    /// Excludes `gc` except with `softening`, where it is the axial stress of the beams at their peak \[Pa\].
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub strength: Option<f64>,
    /// True if beams soften: from `strength` on they lose stiffness along a line, until they have taken what
    /// `gc` needs. Needs both, and spheres below the mean diameter at which beams would break at `strength`.
    #[serde(default)]
    pub softening: bool,
    /// Weibull modulus of the scatter between bonds \[–\]. Default: no scatter.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub weibull: Option<f64>,
    /// Relative standard deviation of a normal scatter, below 1/3 \[–\]; excludes `weibull`. Default: no
    /// scatter.
    #[schemars(extend("minimum" = 0, "exclusiveMaximum" = 1.0 / 3.0))]
    pub deviation: Option<f64>,
    /// Seed of the scatter; strengths depend on the place of a bond, not on the numbering.
    #[serde(default = "first_seed")]
    pub seed: u64,
    /// Steps between two checks. Default: 1.
    #[schemars(range(min = 1))]
    pub every: Option<usize>,
    /// True if bonds that lie in an overlap, wholly or in part, never break. This does not let a crack pass
    /// the overlap: bonds that cannot break carry more load than the body's strength. Always true with a zone
    /// that follows, which grows before.
    #[serde(default)]
    pub spare_overlap: bool,
    /// True to end the run when a crack runs into an overlap: six broken bonds there that are near each other
    /// or joined by others. The results are complete, `status` is `"stopped-at-overlap"`, and `arlequin
    /// resume` continues the run.
    #[serde(default)]
    pub stop_at_overlap: bool,
}

impl Default for Fracture {
    fn default() -> Self {
        Self {
            criterion: None,
            gc: None,
            strength: None,
            softening: false,
            weibull: None,
            deviation: None,
            seed: first_seed(),
            every: None,
            spare_overlap: false,
            stop_at_overlap: false,
        }
    }
}

fn first_seed() -> u64 {
    1
}

/// Failure criteria of bonds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum CriterionKind {
    /// Axial tension.
    Axial,
    /// Largest principal tension of the section.
    Rankine,
    /// Equivalent stress of von Mises.
    Mises,
    /// Elastic energy per section.
    Energy,
    /// Elastic energy per section, in compression only that of bending and torsion, as far as the section is
    /// in tension.
    TensileEnergy,
    /// Hydrostatic stress of a particle in tension; all bonds of the particle break at once.
    Hydrostatic,
}

/// Contact between unbonded particles, or between two models.
#[derive(Debug, Clone, Copy, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[non_exhaustive]
pub struct Contact {
    /// Modulus `E` of the normal spring `2 E r_i r_j/(r_i + r_j)` between unbonded particles, `2 E r` of a
    /// particle on elements, and `2 E/h + 2 E/H` per area of two surfaces with facets of the sizes `h` and
    /// `H` \[Pa\]. Default: `material.young`; with `between`, `2 E F/(E + F)` of both models.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub modulus: Option<f64>,
    /// Coefficient of restitution, 0.15 to 1 \[–\]. Default: 0.5.
    #[schemars(range(min = 0.15, max = 1))]
    pub restitution: Option<f64>,
    /// Coulomb friction \[–\]. Default: 0.
    #[schemars(range(min = 0))]
    pub friction: Option<f64>,
    /// Tangential over normal stiffness \[–\]. Default: 0.5.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub shear_ratio: Option<f64>,
    /// Rolling resistance: lever over reduced radius \[–\]; between particles only. Default: 0.
    #[schemars(range(min = 0))]
    pub rolling: Option<f64>,
    /// Reach of the neighbour list beyond touch, in mean radii, or mean sizes of the facets if they are
    /// smaller \[–\]; not for obstacles. Default: 0.4.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub skin: Option<f64>,
}

/// A rigid body that particles and the surfaces of solids touch. With several models named, a free body
/// moves under the forces of all of them; the body of a scene includes its zones.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(transform = schema::excludes("displacement", "velocity mass"))]
#[schemars(extend("dependencies" = { "inertia": ["mass"], "spin": ["mass"], "spring": ["mass"] }))]
#[non_exhaustive]
pub struct Obstacle {
    /// Name of the ledger line. Default: `obstacle-1`, …
    #[schemars(extend("pattern" = schema::HEADLINE))]
    pub name: Option<String>,
    /// Shape at rest.
    pub shape: ObstacleShape,
    /// Velocity \[m/s\]: constant, or with `mass` the velocity at the start. Default: at rest.
    pub velocity: Option<[f64; 3]>,
    /// Prescribed displacement, instead of `velocity`.
    pub displacement: Option<ObstacleMotion>,
    /// Mass of a free body \[kg\]; each `body_force` of its models acts on the body too. A free sphere
    /// also turns by the friction of `contact`; other shapes do not. Default: driven or fixed.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub mass: Option<f64>,
    /// Moment of inertia of a free sphere \[kg m²\]. Default: that of a full ball, `2/5 mass radius²`.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub inertia: Option<f64>,
    /// Stiffness of a spring that holds a free body to its place at the start, in all directions \[N/m\].
    /// Default: none.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub spring: Option<f64>,
    /// Angular velocity of a free sphere at the start \[rad/s\]. Default: none.
    pub spin: Option<[f64; 3]>,
    /// Contact law. On a surface of elements, the stiffness per area is `4 E/h`, with `h` the size of a
    /// facet.
    #[serde(default)]
    #[schemars(extend("not" = { "anyOf": [{ "required": ["skin"] }, { "required": ["rolling"] }] }))]
    pub contact: Contact,
}

impl Obstacle {
    /// Name of the rigid body of effect `k` in the ledger.
    pub(crate) fn ledger_name(&self, k: usize) -> String {
        self.name.clone().unwrap_or_else(|| format!("obstacle-{}", k + 1))
    }
}

/// Shapes of obstacles.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, remote = "Self", rename_all = "snake_case")]
#[non_exhaustive]
pub enum ObstacleShape {
    /// Half-space behind a plane.
    Plane {
        /// A point of the plane \[m\].
        point: [f64; 3],
        /// Normal towards the models.
        #[schemars(transform = schema::not_zero)]
        normal: [f64; 3],
    },
    /// Ball.
    Sphere {
        /// Centre \[m\].
        centre: [f64; 3],
        /// Radius \[m\].
        #[schemars(extend("exclusiveMinimum" = 0))]
        radius: f64,
    },
    /// Infinite cylinder.
    Cylinder {
        /// A point of the axis \[m\].
        point: [f64; 3],
        /// Direction of the axis.
        #[schemars(transform = schema::not_zero)]
        axis: [f64; 3],
        /// Radius \[m\].
        #[schemars(extend("exclusiveMinimum" = 0))]
        radius: f64,
    },
    /// Circular cone with a flat base.
    Cone {
        /// Tip \[m\].
        tip: [f64; 3],
        /// Direction from the tip to the base.
        #[schemars(transform = schema::not_zero)]
        axis: [f64; 3],
        /// Height \[m\].
        #[schemars(extend("exclusiveMinimum" = 0))]
        height: f64,
        /// Radius of the base \[m\].
        #[schemars(extend("exclusiveMinimum" = 0))]
        radius: f64,
    },
    /// Box.
    Box {
        /// Centre \[m\].
        centre: [f64; 3],
        /// Lengths of the sides \[m\].
        size: [f64; 3],
        /// Rotation vector about the centre \[rad\]. Default: along the axes.
        turn: Option<[f64; 3]>,
    },
    /// Body with a closed surface.
    Solid {
        /// STL file of the surface, relative to the scene file. Its triangles are turned outwards.
        file: PathBuf,
        /// Length of one unit of the file \[m\]. Default: 1.
        #[schemars(extend("exclusiveMinimum" = 0))]
        scale: Option<f64>,
        /// Shift of the body from where the file has it \[m\]. Default: none.
        shift: Option<[f64; 3]>,
    },
}

choice!(
    ObstacleShape,
    "{ plane = { point, normal } }, { sphere = { centre, radius } }, { cylinder = { point, axis, radius } }, \
     { cone = { tip, axis, height, radius } }, { box = { centre, size } }, { solid = { file } }"
);

/// Displacement of an obstacle, `amplitude · time`.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct ObstacleMotion {
    /// Amplitude \[m\].
    pub amplitude: [f64; 3],
    /// Function of time.
    pub time: TimeShape,
}
