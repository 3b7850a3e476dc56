//! Blocks of finite elements, natural elements and particles that touch.

use arlequin::cnem::constraint::Surface;
use arlequin::cnem::domain::Domain;
use arlequin::cnem::{CnemModel, Options};
use arlequin::core::contact::{Exterior, RigidShape, SharedBody, SurfaceObstacle};
use arlequin::core::nalgebra::{Point3, Rotation3, Vector3};
use arlequin::core::{Coupled, Subdomain, Weights};
use arlequin::dem_beam::packing::{Lattice, lattice};
use arlequin::dem_beam::{BeamMaterial, ContactBody, DemModel};
use arlequin::fem_ref::{Elastic, ElementKind, FemModel, Mesh, generate};

pub(crate) const E: f64 = 70e9;
pub(crate) const RHO: f64 = 2500.0;
/// Size of an element \[m\].
pub(crate) const H: f64 = 1e-3;

pub(crate) fn material() -> Elastic<f64> {
    Elastic::new(E, 0.2, RHO).unwrap()
}

/// A block with its exterior.
pub(crate) struct Block {
    pub(crate) side: Subdomain<f64>,
    pub(crate) exterior: Exterior,
}

impl Block {
    fn of_elements(side: Subdomain<f64>) -> Self {
        Self {
            exterior: Exterior::surface(side.model()).unwrap(),
            side,
        }
    }

    pub(crate) fn moving(self, velocity: Vector3<f64>) -> Self {
        Self {
            side: moving(self.side, velocity),
            ..self
        }
    }
}

/// Mesh of a block, turned about its middle.
fn mesh(
    kind: ElementKind,
    low: Vector3<f64>,
    size: Vector3<f64>,
    n: [usize; 3],
    turn: Vector3<f64>,
) -> Mesh<f64> {
    let mesh: Mesh<f64> = generate::block(kind, Point3::from(low), Point3::from(low + size), n).unwrap();
    let middle = Point3::from(low + size * 0.5);
    let turned = mesh
        .nodes()
        .iter()
        .map(|x| middle + Rotation3::new(turn) * (x - middle));
    Mesh::new(kind, turned.collect(), mesh.connectivity().to_vec()).unwrap()
}

/// A block of `n` elements of the size `h` \[m\], turned about its middle: hexahedra ("hex"), tetrahedra
/// ("tet"), natural elements ("cnem"), or bonded spheres half as large ("dem").
pub(crate) fn block(
    kind: &str,
    name: &str,
    low: Vector3<f64>,
    n: [usize; 3],
    h: f64,
    turn: Vector3<f64>,
) -> Block {
    let size = Vector3::from(n.map(|n| n as f64)) * h;
    match kind {
        "dem" => {
            let model = spheres(name, low, n, h, turn);
            let exterior = ContactBody::from_model(&model).exterior();
            Block {
                side: Subdomain::fine(model, Weights::uncoupled()),
                exterior,
            }
        }
        "cnem" => {
            let mesh = mesh(ElementKind::Hex8, low, size, n, turn);
            let domain = Domain::new(mesh.nodes(), &Surface::convex_hull()).unwrap();
            let model = CnemModel::new(name, domain, material(), Options::default()).unwrap();
            Block::of_elements(Subdomain::coarse(model, Weights::uncoupled()))
        }
        kind => {
            let kind = match kind {
                "tet" => ElementKind::Tet4,
                _ => ElementKind::Hex8,
            };
            let model = FemModel::new(name, mesh(kind, low, size, n, turn), material()).unwrap();
            Block::of_elements(Subdomain::coarse(model, Weights::uncoupled()))
        }
    }
}

/// A block of bonded spheres half as large as elements of the size `h` \[m\].
pub(crate) fn spheres(name: &str, low: Vector3<f64>, n: [usize; 3], h: f64, turn: Vector3<f64>) -> DemModel {
    // The lowest sphere at the corner of the block.
    let mut packing = lattice(Lattice::Cubic, n.map(|n| 2 * n), 0.25 * h).unwrap();
    let first = Vector3::repeat(0.25 * h) - packing.positions[0] + low;
    let middle = low + Vector3::from(n.map(|n| n as f64)) * (0.5 * h);
    let turn = Rotation3::new(turn);
    packing
        .positions
        .iter_mut()
        .for_each(|x| *x = middle + turn * (*x + first - middle));
    DemModel::new(name, &packing, BeamMaterial::SILICA, RHO).unwrap()
}

/// A cube of `n³` elements of the size [`H`] with a corner at the origin.
pub(crate) fn cube(kind: &str, n: usize) -> Subdomain<f64> {
    block(kind, "block", Vector3::zeros(), [n; 3], H, Vector3::zeros()).side
}

/// Lets a model of elements touch a rigid body.
pub(crate) fn against(
    s: Subdomain<f64>,
    body: &SharedBody,
    law: arlequin::core::contact::ContactLaw,
) -> Subdomain<f64> {
    let contact = SurfaceObstacle::new(s.model(), body, law).unwrap();
    s.with_effect(Box::new(contact))
}

pub(crate) fn moving(s: Subdomain<f64>, velocity: Vector3<f64>) -> Subdomain<f64> {
    let (nodes, dofs) = (s.model().nodes().len(), s.model().layout().dofs());
    let mut v = vec![0.0; dofs];
    (0..3 * nodes).for_each(|o| v[o] = velocity[o % 3]);
    s.with_initial(vec![0.0; dofs], v).unwrap()
}

/// Bits of all states.
pub(crate) fn bits(run: &Coupled<f64>) -> Vec<u64> {
    let states = run
        .subdomains()
        .iter()
        .flat_map(|s| s.state().q.iter().chain(&s.state().v));
    states.map(|x| x.to_bits()).collect()
}

/// Present places of the nodes of a model.
pub(crate) fn places(s: &Subdomain<f64>) -> impl Iterator<Item = Point3<f64>> + '_ {
    let moved = s.model().nodes().iter().zip(s.state().q.as_chunks::<3>().0);
    moved.map(|(x, u)| x + Vector3::from(*u))
}

/// Deepest place of a node inside a displaced shape \[m\].
pub(crate) fn depth_in<'a>(
    sides: impl Iterator<Item = &'a Subdomain<f64>>,
    shape: &RigidShape,
    moved: &Vector3<f64>,
) -> f64 {
    let depths = sides.flat_map(places).map(|x| -shape.distance(&x, moved).0);
    depths.fold(f64::NEG_INFINITY, f64::max)
}

/// Numbers in [0, 1) that differ from call to call and are the same in every run.
pub(crate) fn random(mut seed: u64) -> impl FnMut() -> f64 {
    move || {
        seed = seed
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (seed >> 11) as f64 / (1_u64 << 53) as f64
    }
}
