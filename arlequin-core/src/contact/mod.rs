//! Contact with penalty springs and energy budgets, for everything that has a surface: the law, the budget of
//! a contact, rigid shapes and their motion, and the contact of surfaces with rigid bodies, with spheres and
//! with each other.
//!
//! Particles have their own lists of pairs in the crate of their model; they use the law, the budgets and the
//! rigid bodies of this module.
//!
//! | module | what |
//! |---|---|
//! | `law` | [`ContactLaw`]: springs, dashpots, friction, rolling |
//! | `budget` | [`BudgetedLaw`]: a contact gives back at most what it took in |
//! | `shape`, `solid` | [`RigidShape`], [`Motion`], [`Solid`] |
//! | `rigid` | [`RigidBody`] and [`SharedBody`]: a rigid body that moves, touched by one model or several |
//! | `points` | points of a surface at which contact acts |
//! | `obstacle` | [`SurfaceObstacle`]: the surface of a continuum against a rigid body |
//! | `exterior` | [`Exterior`]: facets or spheres of a model |
//! | `facet`, `search` | the foot of a point on facets; points near facets |
//! | `between` | [`SurfaceContact`]: a surface against spheres or against another surface |
//! | `closed`, `place` | closed contacts with their springs; places on facets |
//! | `forces` | forces of an effect on one model within a step |

mod between;
mod budget;
mod closed;
mod exterior;
mod facet;
mod forces;
mod law;
mod obstacle;
mod place;
mod points;
mod rigid;
mod search;
mod shape;
mod solid;

pub use between::SurfaceContact;
pub use budget::{BudgetedLaw, End, Proposal};
pub(crate) use closed::largest_turn;
pub use closed::{LARGEST_TURN, PART_LOST};
pub use exterior::Exterior;
pub use law::{ContactLaw, Pair, Response, Spring};
pub use obstacle::SurfaceObstacle;
pub(crate) use place::Triangle;
pub use rigid::{RigidBody, SharedBody};
pub use shape::{Motion, RigidShape};
pub use solid::Solid;

use crate::Result;
use crate::error::invalid;
use nalgebra::Vector3;

/// Displacement \[m\] and rotation \[rad\] of a body, their rates, or force \[N\] and torque \[N m\] on it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Twist {
    /// Translation or force.
    pub linear: Vector3<f64>,
    /// Rotation or torque.
    pub angular: Vector3<f64>,
}

impl Twist {
    /// Returns zero translation and rotation.
    #[must_use]
    pub fn zero() -> Self {
        Self {
            linear: Vector3::zeros(),
            angular: Vector3::zeros(),
        }
    }
}

/// Refuses values that are not finite and above zero.
fn positive(name: &str, value: f64) -> Result<()> {
    if value.is_finite() && value > 0.0 {
        return Ok(());
    }
    Err(invalid(name, value, "must be finite and positive"))
}
