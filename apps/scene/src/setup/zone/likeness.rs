//! Stiffness of a zone's packing in comparison with the body's elements in its place.
//!
//! Each packing differs: it has few spheres across, free surfaces and its own seed. Its stiffness is
//! therefore measured in place. The border to the body, and the components that supports hold, are moved by
//! each of six unit strains; all other particles are in equilibrium. With the zone's share `w` of the energy,
//! `C_kl = u_k · K_w u_l`. The same matrix is computed for the body's elements. The correction factor of the
//! beams' modulus is the projection of one on the other as tensors, so it is independent of the orientation
//! of the body. With an open border, as at the end of a body, both are also loaded by forces. Decision 0041.

use super::Piece;
use crate::error::{Result, core, dem, fem};
use crate::setup::faces::{Faces, corners_of};
use crate::setup::packing::Likeness;
use crate::setup::select::{inside, slack};
use crate::setup::{LoweredModel, materials};
use crate::spec::{Axis, Selection, Support};
use arlequin::core::adjacency::Adjacency;
use arlequin::core::geometry::Cell;
use arlequin::core::nalgebra::{DMatrix, Matrix3, Point3, Vector3};
use arlequin::core::sprs::TriMat;
use arlequin::core::{LinearModel, Model, Overlap, Place, Real, Uniform, Weight};
use arlequin::dem_beam::bond::Twist;
use arlequin::dem_beam::statics::StaticProblem;
use arlequin::dem_beam::{DemModel, Held};
use arlequin::fem_ref::{Facet, FemModel, Mesh};
use std::path::Path;
use std::sync::Arc;

/// Residual of the equilibria of a packing; the error of the stiffness is of the order of its square.
const TOLERANCE: f64 = 3e-3;
/// Largest number of iterations of each equilibrium.
const ITERATIONS: usize = 20_000;

/// Smallest `|∫ n dA|` of an open border, as a share of its area. A ring through a plate of tetrahedra misses
/// zero by some tenths of a per cent, because its outlines on the two faces differ; a pit four times as deep
/// as wide has 0.06, the end of a bar has 1.
const CLOSED: f64 = 0.02;

/// The fine model's share of the energy: one in the zone, falling to zero across the overlap.
struct Share(Arc<dyn Overlap<f64>>);

impl Weight<f64> for Share {
    fn value(&self, x: &Point3<f64>) -> f64 {
        match self.0.place(x) {
            Place::Fine => 1.0,
            Place::Overlap(s) => 1.0 - s,
            Place::Coarse => 0.0,
        }
    }
    /// Value at the centre of the cell; positions are nearly linear in a cell.
    fn mean(&self, cell: &Cell<f64>) -> f64 {
        let corners = cell.corners();
        let sum = corners.iter().fold(Vector3::zeros(), |s, x| s + x.coords);
        self.value(&Point3::from(sum / corners.len() as f64))
    }
}

/// Matrix `u_k · K_w u_l` of a model with weight `share`, for the given fields.
fn energies(model: &mut dyn Model<f64>, share: &Share, fields: &[Vec<f64>]) -> Result<DMatrix<f64>> {
    model.set_internal_weight(share).map_err(core("zone"))?;
    let mut out = DMatrix::zeros(fields.len(), fields.len());
    for (l, u) in fields.iter().enumerate() {
        let mut force = vec![0.0; u.len()];
        model.add_internal_forces(u, &mut force).map_err(core("zone"))?;
        for (k, v) in fields.iter().enumerate() {
            // Internal forces are added with the sign of `−K u`.
            out[(k, l)] = -v.iter().zip(&force).map(|(v, f)| v * f).sum::<f64>();
        }
    }
    Ok((&out + out.transpose()) * 0.5)
}

/// For each point, the components that supports hold. `spacing` \[m\] is that of the points; `group` returns
/// the points of a named group.
fn supported(
    supports: Supports<'_>,
    points: &[Point3<f64>],
    spacing: f64,
    group: &dyn Fn(&str) -> Option<Vec<usize>>,
) -> Vec<[bool; 3]> {
    let mut out = vec![[false; 3]; points.len()];
    for (number, s) in supports {
        let holds = |c: usize| {
            let named = |axes: &Vec<Axis>| axes.iter().any(|a| a.index() == c);
            s.components.as_ref().is_none_or(named)
        };
        let nodes = match &s.at {
            Selection::Group(name) => group(name).unwrap_or_default(),
            Selection::Box(low, high) => group(&format!("support[{number}]")).unwrap_or_else(|| {
                let in_box = |k: &usize| inside(low, high, &points[*k], slack(spacing));
                (0..points.len()).filter(in_box).collect()
            }),
        };
        for k in nodes {
            (0..3).for_each(|c| out[k][c] |= holds(c));
        }
    }
    out
}

/// Displacement of unit strain `k` at `x` \[m\], in the order `xx yy zz yz zx xy`.
fn strained(k: usize, x: &Vector3<f64>) -> Vector3<f64> {
    const PLACE: [[usize; 2]; 6] = [[0, 0], [1, 1], [2, 2], [1, 2], [2, 0], [0, 1]];
    let [i, j] = PLACE[k];
    let mut e = Matrix3::zeros();
    e[(i, j)] += 0.5;
    e[(j, i)] += 0.5;
    e * x
}

/// Supports that hold a model, with their numbers in the scene.
pub(in crate::setup) type Supports<'a> = &'a [(usize, &'a Support)];

/// The body's elements in a zone and its overlap, with which the zone's packing is compared.
pub(in crate::setup) struct Twin<'a> {
    key: &'a str,
    table: &'a LoweredModel,
    /// Young's modulus of the body \[Pa\].
    young: f64,
    mesh: &'a Mesh<f64>,
    share: Share,
    supports: Supports<'a>,
    /// Held components of each node: all on the border to the body, and those that supports hold.
    held: Vec<[bool; 3]>,
    /// For each component, the faces on which supports hold it.
    bearings: [Faces; 3],
    border: Faces,
    middle: Vector3<f64>,
    /// Forces that are distributed over the zone by mass \[N\]; empty for a closed border.
    pulls: Vec<Vector3<f64>>,
}

impl<'a> Twin<'a> {
    /// Prepares the elements of a zone; `None` if they have no border to the body.
    pub(in crate::setup) fn new(
        key: &'a str,
        table: &'a LoweredModel,
        mesh: &'a Mesh<f64>,
        (piece, supports, folder): (&Piece, Supports<'a>, &Path),
    ) -> Result<Option<Self>> {
        let share = Share(piece.overlap(folder)?);
        let is_coarse = |x: &Point3<f64>| matches!(share.0.place(x), Place::Coarse);
        let outer: Vec<bool> = mesh.nodes().iter().map(is_coarse).collect();
        let on_border = |f: &Facet| mesh.facet_nodes(*f).iter().all(|k| outer[*k as usize]);
        let surface = mesh.boundary();
        let faces = |selected: &dyn Fn(&Facet) -> bool| {
            let facets: Vec<_> = surface.iter().copied().filter(selected).collect();
            Faces::new(corners_of(mesh, &facets))
        };
        let border = faces(&on_border);
        let group = |name: &str| {
            let group = mesh.groups().get(name)?;
            Some(group.nodes.iter().map(|k| *k as usize).collect())
        };
        let mut held = supported(supports, mesh.nodes(), mesh.spacing(), &group);
        let bearings = [0, 1, 2]
            .map(|c| faces(&|f| !on_border(f) && mesh.facet_nodes(*f).iter().all(|k| held[*k as usize][c])));
        let supported = [0, 1, 2].map(|c| !bearings[c].is_empty());
        let young = table.known_material(key)?.young;
        let pulls = pulls(border.triangles(), young, supported);
        for (held, outer) in held.iter_mut().zip(&outer) {
            held.iter_mut().for_each(|c| *c |= *outer);
        }
        let sum = mesh.nodes().iter().fold(Vector3::zeros(), |s, x| s + x.coords);
        Ok((!border.is_empty()).then(|| Self {
            key,
            table,
            young,
            mesh,
            share,
            supports,
            middle: sum / mesh.nodes().len() as f64,
            held,
            bearings,
            border,
            pulls,
        }))
    }

    /// Distributes a force `pull` \[N\] over the nodes of a model by mass, so that the zone's share of the
    /// mass carries it.
    fn spread(&self, model: &dyn Model<f64>, pull: &Vector3<f64>) -> Result<Vec<f64>> {
        let mut mass = vec![0.0; model.layout().dofs()];
        let mut share = mass.clone();
        model
            .lumped_inertia(&self.share, &mut share)
            .map_err(core(self.key))?;
        model
            .lumped_inertia(&Uniform(1.0), &mut mass)
            .map_err(core(self.key))?;
        let moved = model.layout().translations();
        let sum = share[..moved].iter().sum::<f64>() / 3.0;
        Ok((0..moved).map(|r| pull[r % 3] * mass[r] / sum).collect())
    }

    /// Displacements of the elements under the six strains of the border, then under the pulls.
    fn equilibria(&self, model: &FemModel<f64>) -> Result<Vec<Vec<f64>>> {
        let whole = model.stiffness();
        let mut place = vec![usize::MAX; whole.rows()];
        let free: Vec<usize> = (0..whole.rows()).filter(|r| !self.held[r / 3][r % 3]).collect();
        free.iter().enumerate().for_each(|(k, r)| place[*r] = k);
        let mut fields: Vec<Vec<f64>> = (0..6)
            .map(|k| {
                let displaced = |(x, held): (&Point3<f64>, &[bool; 3])| {
                    let held = Vector3::from(held.map(|h| f64::from(u8::from(h))));
                    strained(k, &(x.coords - self.middle)).component_mul(&held)
                };
                let nodes = self.mesh.nodes().iter().zip(&self.held);
                nodes.flat_map(|n| <[f64; 3]>::from(displaced(n))).collect()
            })
            .collect();
        fields.resize(6 + self.pulls.len(), vec![0.0; whole.rows()]);
        if free.is_empty() {
            return Ok(fields);
        }
        let mut matrix = TriMat::new((free.len(), free.len()));
        let mut sides = vec![0.0; 6 * free.len()];
        for pull in &self.pulls {
            let force = self.spread(model, pull)?;
            sides.extend(free.iter().map(|r| force[*r]));
        }
        for (v, (r, c)) in whole.iter() {
            match (place[r], place[c]) {
                (usize::MAX, _) => {}
                // Prescribed displacements move to the right-hand side.
                (row, usize::MAX) => {
                    (0..6).for_each(|k| sides[k * free.len() + row] -= v * fields[k][c]);
                }
                // The small addition to the diagonal keeps parts that nothing holds at rest.
                (row, column) => matrix.add_triplet(row, column, if r == c { v * (1.0 + 1e-9) } else { *v }),
            }
        }
        let mut factor = f64::cholesky(&matrix.to_csr(), None).map_err(core(self.key))?;
        factor.solve(&mut sides);
        for (field, solved) in fields.iter_mut().zip(sides.chunks(free.len())) {
            free.iter().zip(solved).for_each(|(r, u)| field[*r] = *u);
        }
        Ok(fields)
    }

    /// Returns whether a sphere moves with the border: it is within a mean diameter of the border or beyond
    /// it.
    fn on_border(&self, model: &DemModel, x: &Point3<f64>) -> bool {
        let rim = 2.0 * model.body().mean_radius();
        self.border.distance(x) < rim || matches!(self.share.0.place(x), Place::Coarse)
    }

    /// Displacement of a sphere under unit strain `k`, for its held components. A support moves the centres
    /// of spheres that touch a face like the face itself: a layer one radius thick is then rigid, which is
    /// part of the packing's stiffness.
    fn moved(&self, k: usize, model: &DemModel, (x, held): (&Point3<f64>, &Held)) -> Vector3<f64> {
        let displaced = |x: &Point3<f64>| strained(k, &(x.coords - self.middle));
        let mut out = displaced(x);
        if held.linear.contains(&true) && !self.on_border(model, x) {
            for c in (0..3).filter(|c| held.linear[*c]) {
                out[c] = self.bearings[c]
                    .foot(x)
                    .map_or(out[c], |foot| displaced(&foot)[c]);
            }
        }
        out
    }

    /// Held components of each sphere: all within a diameter of the border, and those that supports hold.
    fn holds(&self, model: &DemModel, group: &dyn Fn(&DemModel, &str) -> Option<Vec<usize>>) -> Vec<Held> {
        let spacing = 2.0 * model.body().mean_radius();
        let fixed = supported(self.supports, model.nodes(), spacing, &|name| group(model, name));
        let held = |(x, fixed): (&Point3<f64>, [bool; 3])| {
            let rim = self.on_border(model, x);
            Held {
                linear: fixed.map(|f| f || rim),
                ..Held::default()
            }
        };
        model.nodes().iter().zip(fixed).map(held).collect()
    }

    /// Displacements and rotations of a packing under the six strains, then under the pulls.
    fn settle(&self, model: &DemModel, held: &[Held]) -> Result<Vec<Vec<f64>>> {
        let body = model.body();
        let solved = |problem: StaticProblem| {
            let solution = problem.solve(body, TOLERANCE, ITERATIONS);
            let solution = solution.map_err(dem(self.key))?.displacements;
            let moves = solution.iter().flat_map(|t| <[f64; 3]>::from(t.linear));
            let turns = solution.iter().flat_map(|t| <[f64; 3]>::from(t.angular));
            Ok(moves.chain(turns).collect())
        };
        let mut out = Vec::new();
        for k in 0..6 {
            let moved = |sphere| Twist {
                linear: self.moved(k, model, sphere),
                ..Twist::zero()
            };
            let problem = StaticProblem {
                held: held.to_vec(),
                start: model.nodes().iter().zip(held).map(moved).collect(),
                ..StaticProblem::free(body.len())
            };
            out.push(solved(problem)?);
        }
        for pull in &self.pulls {
            out.push(solved(self.hanging(model, held, pull)?)?);
        }
        Ok(out)
    }

    /// Static problem of a packing that hangs on its border under a force. Spheres at the border cannot
    /// rotate, so that everything bonded to them is held; particles that are not connected to them carry no
    /// load.
    fn hanging(&self, model: &DemModel, held: &[Held], pull: &Vector3<f64>) -> Result<StaticProblem> {
        let body = model.body();
        let mut problem = StaticProblem::free(body.len());
        problem.held = held.to_vec();
        let force = self.spread(model, pull)?;
        let ends = |&[i, j]: &[u32; 2]| [(i, j), (j, i)];
        let bonds = Adjacency::new(body.len(), body.pairs().iter().flat_map(ends));
        let mut joined = vec![false; body.len()];
        let mut next: Vec<usize> = (0..body.len())
            .filter(|p| self.on_border(model, &model.nodes()[*p]))
            .collect();
        for p in &next {
            problem.held[*p] = Held::ALL;
            joined[*p] = true;
        }
        while let Some(p) = next.pop() {
            problem.loads[p].linear = Vector3::from_fn(|c, _| force[3 * p + c]);
            for q in bonds.row(p) {
                if !std::mem::replace(&mut joined[*q as usize], true) {
                    next.push(*q as usize);
                }
            }
        }
        Ok(problem)
    }

    /// Measures the stiffness of a packing. With `chosen`, the modulus of the beams is corrected to match the
    /// body. `None` if the packing cannot be measured: it needs a border and an inside.
    pub(in crate::setup) fn likeness(
        &self,
        mut model: DemModel,
        chosen: bool,
        group: &dyn Fn(&DemModel, &str) -> Option<Vec<usize>>,
    ) -> Result<Option<Likeness>> {
        let materials = materials::element_materials(self.key, self.table, self.mesh)?;
        let elements = FemModel::new("body", self.mesh.clone(), materials);
        let mut elements = elements.map_err(fem(self.key))?;
        let fields = self.equilibria(&elements)?;
        let body_energies = energies(&mut elements, &self.share, &fields)?;
        let held = self.holds(&model, group);
        let fields = self.settle(&model, &held)?;
        let packing_energies = energies(&mut model, &self.share, &fields)?;
        let blocks = |first: usize, count: usize| {
            let part = |energies: &DMatrix<f64>| energies.view((first, first), (count, count)).into_owned();
            [part(&packing_energies), part(&body_energies)]
        };
        let Some(strained) = Compared::strained(&blocks(0, 6)) else {
            return Ok(None);
        };
        let Some(hanging) = Compared::hanging(&blocks(6, self.pulls.len())) else {
            return Ok(None);
        };
        // Strains and stresses have different energies; the larger energy gets the larger weight.
        let weight = hanging.size / (strained.size + hanging.size);
        let blend = |a: f64, b: f64| (1.0 - weight) * a + weight * b;
        // A geometric mean: twice as stiff and half as stiff weigh alike.
        let factor = blend(strained.factor.ln(), hanging.factor.ln()).exp();
        let uneven = blend(strained.deviation, hanging.deviation).sqrt();
        let diameter = 2.0 * model.body().mean_radius();
        let across = |pull: &Vector3<f64>| (pull.norm() / self.young).sqrt() / diameter;
        // Stiffness is proportional to the modulus of the beams.
        Ok(Some(Likeness {
            stiffness: if chosen { 1.0 } else { factor },
            uneven,
            beams: if chosen { 1.0 / factor } else { 1.0 },
            across: self.pulls.first().map(across),
        }))
    }
}

/// Forces on a zone whose border is open \[N\]: for each axis along which no support holds a face of the
/// zone, the force of a stress `E` on the border.
///
/// A closed border (`∫ n dA = 0`) strains the zone by itself. At the end of a body the strain decays away
/// from the border, and the zone's load comes from its own surface.
fn pulls(border: &[[Point3<f64>; 3]], young: f64, supported: [bool; 3]) -> Vec<Vector3<f64>> {
    let areas = border.iter().map(|[a, b, c]| (b - a).cross(&(c - a)) * 0.5);
    let (sum, size) = areas.fold((Vector3::zeros(), 0.0), |(sum, size), a| {
        (sum + a, size + a.norm())
    });
    let axes = (0..3).filter(|c| sum.norm() > CLOSED * size && !supported[*c]);
    axes.map(|c| Vector3::ith(c, young * sum.norm())).collect()
}

/// A packing in comparison with the body's elements.
#[derive(Debug)]
struct Compared {
    /// Stiffness over that of the elements.
    factor: f64,
    /// Squared relative deviation from the elements after scaling by the factor.
    deviation: f64,
    /// Square of the elements' energies \[J²\]; the weight of the comparison.
    size: f64,
}

impl Compared {
    /// Comparison under strains of the border: projection of one stiffness on the other as tensors of fourth
    /// order.
    fn strained([found, wanted]: &[DMatrix<f64>; 2]) -> Option<Self> {
        let size = inner(wanted, wanted);
        let factor = inner(found, wanted) / size;
        let deviation = found / factor - wanted;
        Self::sound(factor, inner(&deviation, &deviation) / size, size)
    }

    /// Comparison under forces, whose work is proportional to the inverse of the stiffness. The mean over all
    /// directions is relative to the elements' work in each, as bending may be much softer than tension.
    fn hanging([found, wanted]: &[DMatrix<f64>; 2]) -> Option<Self> {
        if wanted.is_empty() {
            return Self::sound(1.0, 0.0, 0.0);
        }
        let root = wanted.clone().cholesky()?.l().try_inverse()?;
        let softer = &root * found * root.transpose();
        let count = softer.nrows();
        let mean = softer.trace() / count as f64;
        let deviation = softer / mean - DMatrix::identity(count, count);
        Self::sound(
            1.0 / mean,
            deviation.norm_squared() / count as f64,
            wanted.norm_squared(),
        )
    }

    /// Returns `None` if the numbers are not finite or the packing carries no load.
    fn sound(factor: f64, deviation: f64, size: f64) -> Option<Self> {
        (factor > 0.0 && factor.is_finite() && deviation.is_finite()).then_some(Self {
            factor,
            deviation,
            size,
        })
    }
}

/// Inner product of two stiffnesses as tensors of fourth order.
fn inner(a: &DMatrix<f64>, b: &DMatrix<f64>) -> f64 {
    // Each shear index of the matrix stands for two tensor components.
    let times = |k: usize| if k < 3 { 1.0 } else { 2.0 };
    let entries = (0..36).map(|k| (k / 6, k % 6));
    entries
        .map(|(i, j)| times(i) * times(j) * a[(i, j)] * b[(i, j)])
        .sum()
}
