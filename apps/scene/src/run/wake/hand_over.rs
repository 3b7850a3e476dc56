//! Hands the state of the sleeping scene over to the full scene.

use crate::error::{Result, core, value};
use crate::setup::{Built, ModelInfo, Start};
use crate::spec::Wake;
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::core::snapshot::Record;
use arlequin::core::{
    Coupled, DofLayout, Error as Core, Interpolation, PrescribedMotion, ShapeRow, Subdomain,
};
use rayon::prelude::*;

/// Largest distance of a node from the sleeping scene's field, in units of the field's spacing.
const REACH: f64 = 0.5;
/// Bisection steps on the line to the nearest node, enough for round-off.
const HALVINGS: usize = 50;

/// A model of the full scene, and the source of its state.
#[derive(Debug)]
struct Target {
    name: String,
    /// Index of the source in the sleeping scene.
    source: usize,
    /// Spacing of the source \[m\].
    spacing: f64,
    /// True if the model takes over from the carrier: the model that woke, or the carrier itself.
    replaces: bool,
    points: Vec<Point3<f64>>,
    layout: DofLayout,
    inertia: Vec<f64>,
    /// Own step in the full scene \[s\].
    dt: f64,
    free: Vec<bool>,
    supports: Vec<PrescribedMotion<f64>>,
}

impl Target {
    /// Returns whether `from` is the same model, which keeps its state.
    fn is_same_model(&self, from: &Subdomain<f64>) -> bool {
        from.model().nodes() == self.points && from.model().layout() == self.layout
    }
}

/// Transfers the state from the sleeping scene to the full scene.
#[derive(Debug)]
pub(super) struct HandOver {
    targets: Vec<Target>,
    carrier: usize,
    carrier_name: String,
}

/// A row of shape functions at a point inside the field, and the vector from that point to the requested one.
struct Placed {
    row: ShapeRow<f64>,
    way: Vector3<f64>,
}

impl HandOver {
    /// Prepares the transfer and tries it with the state at the start, so that errors show before the first
    /// step.
    pub(super) fn new(
        wake: &Wake,
        awake: &Built,
        asleep: &Coupled<f64>,
        models: &[ModelInfo],
    ) -> Result<Self> {
        let names: Vec<&str> = asleep.subdomains().iter().map(|s| s.model().name()).collect();
        let find = |name: &str| {
            let from = if name == wake.model { &wake.by } else { name };
            names.iter().position(|n| *n == from).unwrap_or_default()
        };
        let target = |s: &Subdomain<f64>| {
            let name = s.model().name().to_owned();
            let source = find(&name);
            Target {
                source,
                spacing: models[source].spacing,
                replaces: name == wake.model || name == wake.by,
                points: s.model().nodes().to_vec(),
                layout: s.model().layout(),
                inertia: s.inertia().to_vec(),
                dt: s.own_dt(),
                free: s.inverse_inertia().iter().map(|x| *x > 0.0).collect(),
                supports: s.supports().to_vec(),
                name,
            }
        };
        let out = Self {
            targets: awake.run.subdomains().iter().map(target).collect(),
            carrier: find(&wake.by),
            carrier_name: wake.by.clone(),
        };
        for t in &out.targets {
            let from = &asleep.subdomains()[t.source];
            if from.model().layout().components != t.layout.components {
                let rule = format!(
                    "moves along x only or in space, unlike '{}'; take models alike",
                    t.name
                );
                return Err(value("wake.by", &wake.by, &rule));
            }
        }
        // The result is dropped: this call finds the errors before the first step instead of after hours of
        // steps.
        out.start(asleep)?;
        Ok(out)
    }

    /// Returns the state from which the full scene starts.
    pub(super) fn start(&self, asleep: &Coupled<f64>) -> Result<Start> {
        let mut states = Vec::with_capacity(self.targets.len());
        let mut memories = Vec::with_capacity(self.targets.len());
        for t in &self.targets {
            let from = &asleep.subdomains()[t.source];
            let memory = from.model().save();
            // A model that is the same in both scenes goes on with its history, such as its orientations.
            memories.push((t.is_same_model(from) && memory != Record::default()).then_some(memory));
            let mut state = self.sample(t, from)?;
            // Held unknowns start on their prescribed motion, which interpolation only approximates.
            for motion in &t.supports {
                let (q, v, _) = motion.kinematics(asleep.time(), t.dt);
                for &d in &motion.dofs {
                    state[0][d] = q;
                    state[1][d] = v;
                }
            }
            states.push(state);
        }
        let wanted = asleep.subdomains()[self.carrier].momentum()[0];
        self.balance(wanted, &mut states);
        Ok(Start {
            time: asleep.time(),
            states,
            memories,
        })
    }

    /// Interpolates displacements and velocities; rotations are half their curl.
    fn sample(&self, t: &Target, from: &Subdomain<f64>) -> Result<[Vec<f64>; 2]> {
        let state = from.state();
        if t.is_same_model(from) {
            return Ok([state.q.clone(), state.v.clone()]);
        }
        let (d, field) = (t.layout.components, &**from.field());
        let rows: Vec<[[Vector3<f64>; 2]; 2]> = t
            .points
            .par_iter()
            .map(|x| {
                let placed = self.place(t, field, x)?;
                Ok([
                    value_and_turn(&placed, &state.q, d),
                    value_and_turn(&placed, &state.v, d),
                ])
            })
            .collect::<Result<_>>()?;
        let turns = t.layout.turns();
        let first = t.layout.translations();
        let mut out = [vec![0.0; t.layout.dofs()], vec![0.0; t.layout.dofs()]];
        for (k, row) in rows.iter().enumerate() {
            for (values, [value, turn]) in out.iter_mut().zip(row) {
                values[k * d..(k + 1) * d].copy_from_slice(&value.as_slice()[..d]);
                if turns {
                    values[first + 3 * k..first + 3 * k + 3].copy_from_slice(turn.as_slice());
                }
            }
        }
        Ok(out)
    }

    /// Evaluates the field at a point. For a point outside, uses the last point inside on the line to the
    /// nearest node.
    fn place(&self, t: &Target, field: &dyn Interpolation<f64>, x: &Point3<f64>) -> Result<Placed> {
        let mut row = ShapeRow::default();
        if inside(field, x, &mut row)? {
            let way = Vector3::zeros();
            return Ok(Placed { row, way });
        }
        let distance = |n: &Point3<f64>| (n - x).norm_squared();
        // Nodes lie in the field for certain, so the way to one of them leads inside.
        let nearest = field
            .nodes()
            .iter()
            .min_by(|a, b| distance(a).total_cmp(&distance(b)));
        let Some(node) = nearest.copied() else {
            return Err(self.outside_error(t, x, f64::INFINITY));
        };
        // Shares of the way from the point to the nearest node, which lies in the field.
        let (mut out, mut good) = (0.0, 1.0);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (out + good);
            if inside(field, &(x + (node - x) * middle), &mut row)? {
                good = middle;
            } else {
                out = middle;
            }
        }
        let way = (x - node) * good;
        // Farther out the sleeping scene lacks a part of the body, which no continuation replaces.
        if way.norm() > REACH * t.spacing || !inside(field, &(x - way), &mut row)? {
            return Err(self.outside_error(t, x, way.norm()));
        }
        Ok(Placed { row, way })
    }

    fn outside_error(&self, t: &Target, x: &Point3<f64>, gap: f64) -> crate::error::Error {
        let rule = format!(
            "'{}' has a node at {:?} m, {gap:.3e} m outside of what is there while '{}' stands alone (allowed: {:.3e} m); \
             make it cover the whole body by assignments in wake.asleep",
            t.name,
            x.coords.as_slice(),
            self.carrier_name,
            REACH * t.spacing
        );
        value("wake.by", &self.carrier_name, &rule)
    }

    /// Adds a uniform velocity to all free unknowns, so that the models that take over from the carrier have
    /// its momentum `wanted`.
    fn balance(&self, wanted: Vector3<f64>, states: &mut [[Vec<f64>; 2]]) {
        let (mut momentum, mut mass) = (Vector3::<f64>::zeros(), Vector3::<f64>::zeros());
        let replacing = || self.targets.iter().enumerate().filter(|(_, t)| t.replaces);
        for (k, t) in replacing() {
            let d = t.layout.components;
            for i in 0..t.layout.translations() {
                momentum[i % d] += t.inertia[i] * states[k][1][i];
                // Held unknowns keep their motion, so that only free ones share the change.
                if t.free[i] {
                    mass[i % d] += t.inertia[i];
                }
            }
        }
        let change: Vector3<f64> = Vector3::from_fn(|c, _| {
            if mass[c] > 0.0 {
                (wanted[c] - momentum[c]) / mass[c]
            } else {
                0.0
            }
        });
        for (k, t) in replacing() {
            let d = t.layout.components;
            for i in (0..t.layout.translations()).filter(|i| t.free[*i]) {
                states[k][1][i] += change[i % d];
            }
        }
    }
}

/// Evaluates the field, with gradients if it has them. Returns whether the point is inside.
fn inside(field: &dyn Interpolation<f64>, x: &Point3<f64>, row: &mut ShapeRow<f64>) -> Result<bool> {
    let evaluated = match field.shape_at(x, true, row) {
        Err(Core::NoGradient { .. }) => field.shape_at(x, false, row),
        evaluated => evaluated,
    };
    match evaluated {
        Ok(()) => Ok(true),
        Err(Core::OutsideDomain { .. }) => Ok(false),
        Err(e) => Err(core("wake.by")(e)),
    }
}

/// Returns the value, extrapolated by the gradient if the point is outside, and half the curl.
fn value_and_turn(placed: &Placed, values: &[f64], d: usize) -> [Vector3<f64>; 2] {
    let (mut value, mut turn) = (Vector3::zeros(), Vector3::zeros());
    for (k, &node) in placed.row.nodes.iter().enumerate() {
        let mut u = Vector3::zeros();
        u.as_mut_slice()[..d].copy_from_slice(&values[node * d..(node + 1) * d]);
        value += u * placed.row.values[k];
        if let Some(g) = placed.row.gradients.get(k) {
            // The point lies outside by `way`: the field goes on linearly.
            value += u * g.dot(&placed.way);
            turn += g.cross(&u) * 0.5;
        }
    }
    [value, turn]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Shape functions of a tetrahedron at its centre: `u = t + ω × x` is handed over with its value and its
    /// rotation `ω`, also for a point outside.
    #[test]
    fn a_turning_body_hands_its_rotation_over_with_its_sign() {
        let nodes = [
            Vector3::zeros(),
            Vector3::x(),
            Vector3::y() * 2.0,
            Vector3::new(0.2, 0.3, 1.5),
        ];
        let points = nodes.map(Point3::from).to_vec();
        let mesh =
            arlequin::fem_ref::Mesh::new(arlequin::fem_ref::ElementKind::Tet4, points, vec![0, 1, 2, 3]);
        let field = arlequin::fem_ref::FemField::new(mesh.expect("one tetrahedron"));
        let (spin, shift) = (Vector3::new(0.3, -0.5, 0.7), Vector3::new(1.0, 2.0, -1.0));
        let motion = |x: &Vector3<f64>| shift + spin.cross(x);
        let values: Vec<f64> = nodes.iter().flat_map(|x| <[f64; 3]>::from(motion(x))).collect();
        let centre = nodes.iter().sum::<Vector3<f64>>() / 4.0;
        for way in [Vector3::zeros(), Vector3::new(0.1, -0.2, 0.3)] {
            let mut row = ShapeRow::default();
            field
                .shape_at(&Point3::from(centre), true, &mut row)
                .expect("inside");
            let [value, turn] = value_and_turn(&Placed { row, way }, &values, 3);
            assert!((value - motion(&(centre + way))).norm() < 1e-14, "{value}");
            assert!((turn - spin).norm() < 1e-14, "turns by {turn} instead of {spin}");
        }
    }
}
