//! Overlaps in difficult places: at supports and loads, in a corner, at a free surface, around a hole.

use super::naive::{Naive, Rule};
use super::{HardCase, Outcome, shaken};
use crate::line::Line;
use crate::solid::{self, block, material};
use arlequin::core::effect::Load;
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::core::{
    Coupled, Error, H1Gradient, InterfaceOptions, InterfaceSpec, L2, Overlap, Partition, Place,
    PrescribedMotion, Primitive, Profile, Ramp, Result, Shell, Silent, Subdomain, TimeFunction, TimeStep,
    Uniform, Weight, Weights,
};
use arlequin::fem_ref::{ElementKind, FemField, FemModel, Mesh};
use std::collections::HashMap;
use std::sync::Arc;

pub(super) const CASES: &[HardCase] = &[
    HardCase {
        name: "overlap that touches supports",
        why: "multipliers act on unknowns that cannot move; where both models are fixed the operator has empty rows",
        naive: "inverting the operator with empty rows: NaN in the first step",
        promise: "such multipliers are dropped and reported; invariant and supports are kept",
        fast: true,
        run: supports,
    },
    HardCase {
        name: "overlap that touches loads",
        why: "both models have the loaded surface",
        naive: "the load acts in full on both models",
        promise: "the momentum equals the impulse, the ledger closes",
        fast: true,
        run: loads,
    },
    HardCase {
        name: "overlap around a corner and at a free surface",
        why: "borders of the overlap meet at an edge and at a point",
        naive: "a product of one weight per direction: the shares do not sum to one",
        promise: "mass exact, invariant and momenta kept",
        fast: true,
        run: corner,
    },
    HardCase {
        name: "overlap around a hole",
        why: "the mediator must not span what neither model fills",
        naive: "a mediator that spans the hole: multipliers without material",
        promise: "refused with the measure outside; a trimmed mediator keeps the invariant",
        fast: true,
        run: hole,
    },
];

/// Returns the elements of a mesh whose centres satisfy `keep`, as a new mesh.
fn carved(mesh: &Mesh<f64>, keep: impl Fn(&Point3<f64>) -> bool) -> Result<Mesh<f64>> {
    let mut index: HashMap<u32, u32> = HashMap::new();
    let (mut nodes, mut connectivity) = (Vec::new(), Vec::new());
    for e in 0..mesh.element_count() {
        let corners = mesh.element(e);
        let sum = corners
            .iter()
            .fold(Vector3::zeros(), |s, n| s + mesh.nodes()[*n as usize].coords);
        if !keep(&Point3::from(sum / corners.len() as f64)) {
            continue;
        }
        for n in corners {
            let next = nodes.len() as u32;
            // Nodes are numbered in the order of their first use.
            let k = *index.entry(*n).or_insert_with(|| {
                nodes.push(mesh.nodes()[*n as usize]);
                next
            });
            connectivity.push(k);
        }
    }
    Ok(Mesh::new(mesh.kind(), nodes, connectivity)?)
}

fn two(coarse: Mesh<f64>, fine: Mesh<f64>, weights: Weights<f64>) -> Result<[Subdomain<f64>; 2]> {
    let fine_weights = Weights::complement_of(std::slice::from_ref(&weights));
    Ok([
        Subdomain::coarse(FemModel::new("left", coarse, material()?)?, weights),
        Subdomain::fine(FemModel::new("right", fine, material()?)?, fine_weights),
    ])
}

fn couple(bodies: Vec<Subdomain<f64>>, mediator: Mesh<f64>, length: f64) -> Result<Coupled<f64>> {
    let interface = InterfaceSpec {
        name: "overlap".into(),
        coarse: 0,
        fine: 1,
        mediator: Arc::new(FemField::new(mediator)),
        junction: if length > 0.0 {
            Box::new(H1Gradient::new(length)?)
        } else {
            Box::new(L2)
        },
        options: InterfaceOptions::default(),
    };
    Coupled::new(bodies, vec![interface], TimeStep::Fraction(0.9), None)
}

fn mass(c: &Coupled<f64>) -> f64 {
    // A node has its mass once per component.
    c.subdomains()
        .iter()
        .flat_map(|s| s.inertia().iter().step_by(3))
        .sum()
}

fn supports() -> Result<Outcome> {
    let mut out = Outcome::default();
    // The lower faces of both bodies are clamped all along the overlap, and one corner of the overlap
    // completely.
    let low = |x: &Point3<f64>| x.z < 1e-9 || (x.x > 2.0 - 1e-9 && x.x < 2.51 && x.y < 0.51 && x.z < 0.51);
    let left = block(ElementKind::Hex8, [0.0, 3.0], [6, 2, 2])?;
    let right = block(ElementKind::Hex8, [2.0, 4.0], [8, 4, 4])?;
    let fixed = |m: &Mesh<f64>| {
        let nodes = m.nodes_where(low);
        PrescribedMotion::fixed(nodes.iter().flat_map(|n| 3 * n..3 * n + 3).collect())
    };
    let (a, b) = (fixed(&left), fixed(&right));
    let fixed_unknowns = [a.dofs.clone(), b.dofs.clone()];
    let [left, right] = two(left, right, solid::weights(Profile::Cubic, 0.0)?)?;
    let bodies = shaken([left.with_support(a), right.with_support(b)], 4)?;
    let mediator = block(ElementKind::Hex8, solid::OVERLAP, [4, 4, 4])?;
    let mut c = couple(bodies, mediator, 0.0)?;
    let report = c.interfaces()[0].report();
    out.add(
        "multiplier unknowns dropped",
        report.null_modes.len() as f64,
        1.0..=400.0,
    );
    out.add("warnings", report.warnings.len() as f64, 1.0..=9.0);
    c.run(500, &mut Silent)?;
    out.add("drift", c.drift(), 0.0..=1e-11);
    let moved = c.subdomains().iter().zip(&fixed_unknowns).flat_map(|(s, h)| {
        let q = &s.state().q;
        h.iter().map(|d| q[*d].abs())
    });
    out.add(
        "largest displacement of a support (m)",
        moved.fold(0.0, f64::max),
        0.0..=0.0,
    );
    let naive = clamped_line()?;
    out.add_naive(
        "energy over that of the start (NaN counted as infinite)",
        naive,
        1e6..=f64::INFINITY,
    );
    Ok(out)
}

/// Returns the energy growth of the naive step when both models are clamped over half of the overlap.
fn clamped_line() -> Result<f64> {
    let line = Line {
        coarse_elements: 20,
        fine_bonds: 120,
        overlap: 40.0,
        mediator: 5.0,
        ..Line::default()
    };
    let [bar, chain] = line.subdomains(&|_| (0.0, 0.0), &|x| (0.0, if x > 20.0 { 1.0 } else { 0.0 }))?;
    let inside = |s: &Subdomain<f64>| {
        let nodes = s.model().nodes().iter().enumerate();
        nodes
            .filter(|(_, x)| x.x >= -40.0 && x.x <= -20.0)
            .map(|(k, _)| k)
            .collect()
    };
    let (a, b) = (inside(&bar), inside(&chain));
    let bodies = vec![
        bar.with_support(PrescribedMotion::fixed(a)),
        chain.with_support(PrescribedMotion::fixed(b)),
    ];
    let c = line.build_with(bodies)?;
    let mut naive = Naive::new(&c, &*line.mediator_space()?, 0.0, Rule::Refined)?;
    Ok(naive.run(0.5, 10).growth)
}

/// Returns the momentum gained over the impulse applied to the loaded upper faces of both bodies, and the
/// drift.
fn loaded(external_everywhere: bool) -> Result<[f64; 2]> {
    let mut weights = solid::weights(Profile::Cubic, 0.01)?;
    let mut fine_weights = Weights::complement_of(std::slice::from_ref(&weights));
    // Loads act in full on both models, as in naive code.
    if external_everywhere {
        weights.external = Arc::new(Uniform(1.0));
        fine_weights.external = Arc::new(Uniform(1.0));
    }
    let left = block(ElementKind::Hex8, [0.0, 3.0], [6, 2, 2])?;
    let right = block(ElementKind::Hex8, [2.0, 4.0], [8, 4, 4])?;
    let pull = |_: &arlequin::core::effect::SurfaceFacet<f64>| Vector3::new(0.0, 0.0, 1e-3);
    let load = |m: &Mesh<f64>| {
        let surface = m.surface_where(|x| x.z > 1.0 - 1e-9 && x.x > 2.0 && x.x < 3.0);
        Load::traction("pull", surface, &pull, TimeFunction::Step)
    };
    let (a, b) = (load(&left)?, load(&right)?);
    let left = Subdomain::coarse(FemModel::new("left", left, material()?)?, weights).with_effect(Box::new(a));
    let left = left.with_partition(if external_everywhere {
        Partition::Unchecked
    } else {
        Partition::Checked
    });
    let right =
        Subdomain::fine(FemModel::new("right", right, material()?)?, fine_weights).with_effect(Box::new(b));
    let mediator = block(ElementKind::Hex8, solid::OVERLAP, [2, 2, 2])?;
    let mut c = couple(vec![left, right], mediator, 0.2)?;
    let steps = 500;
    c.run(steps, &mut Silent)?;
    // The load acts on the upper face of the overlap, a unit square.
    let impulse = 1e-3 * c.time();
    Ok([c.momentum()[0].z / impulse, c.drift()])
}

fn loads() -> Result<Outcome> {
    let mut out = Outcome::default();
    let [gained, drift] = loaded(false)?;
    out.add("momentum over impulse", gained, 0.99..=1.01);
    out.add("drift", drift, 0.0..=1e-11);
    let [naive, _] = loaded(true)?;
    out.add_naive("momentum over impulse", naive, 1.9..=2.1);
    Ok(out)
}

/// Product of two ramps, one per direction. The fine model gets the product of their complements, so the
/// sum is not one.
struct Product([Ramp<f64>; 2], bool);

impl Weight<f64> for Product {
    fn value(&self, x: &Point3<f64>) -> f64 {
        let f = [self.0[0].value(x), self.0[1].value(x)];
        if self.1 {
            f[0] * f[1]
        } else {
            (1.0 - f[0]) * (1.0 - f[1])
        }
    }
}

/// Returns the share of mass that is lost if the product of two ramps weights the coarse model and the
/// product of their complements the fine model.
fn product_defect() -> Result<f64> {
    let ramp = |axis: usize| -> Result<Ramp<f64>> {
        let point = |s: f64| Point3::from(Vector3::from_fn(|k, _| if k == axis { s } else { 0.0 }));
        let slab = arlequin::core::Slab::between(point(1.0), point(2.0))?;
        Ramp::new(Arc::new(slab), Profile::Cubic, 0.0)
    };
    let pair = |coarse| -> Result<Product> { Ok(Product([ramp(0)?, ramp(1)?], coarse)) };
    let weights = [pair(true)?, pair(false)?];
    // Midpoint rule over the region where both ramps fall.
    let n = 200;
    let cell = |k: usize| 1.0 + (k as f64 + 0.5) / n as f64;
    let mut sum = 0.0;
    for i in 0..n {
        for j in 0..n {
            let x = Point3::new(cell(i), cell(j), 0.5);
            sum += weights.iter().map(|w| w.value(&x)).sum::<f64>();
        }
    }
    Ok(1.0 - sum / (n * n) as f64)
}

/// Coarse body, fine body in it, and the overlap between two blocks. The inner block belongs to the fine
/// model alone.
struct Nest {
    coarse: Mesh<f64>,
    fine: Mesh<f64>,
    mediator: Mesh<f64>,
    overlap: Arc<dyn Overlap<f64>>,
    volume: f64,
}

/// Builds the bodies. `counts` are the elements of coarse body, fine body and mediator.
fn nest(
    whole: [[f64; 3]; 2],
    inner: [[f64; 3]; 2],
    outer: [[f64; 3]; 2],
    counts: [[usize; 3]; 3],
) -> Result<Nest> {
    let p = Point3::from;
    let far = |b: [[f64; 3]; 2]| Primitive::Block {
        low: Point3::from(Vector3::from_fn(|k, _| {
            // At a free surface the block extends beyond the body, so that the weight does not fall there.
            if b[0][k] <= whole[0][k] { -50.0 } else { b[0][k] }
        })),
        high: Point3::from(Vector3::from_fn(|k, _| {
            if b[1][k] >= whole[1][k] { 50.0 } else { b[1][k] }
        })),
    };
    let shell = Shell {
        fine_core: far(inner),
        fine_domain: far(outer),
    };
    let inside = |x: &Point3<f64>| matches!(shell.place(x), Place::Fine);
    let generate = |kind, b: [[f64; 3]; 2], n| arlequin::fem_ref::generate::block(kind, p(b[0]), p(b[1]), n);
    let coarse = generate(ElementKind::Hex8, whole, counts[0])?;
    let mediator = generate(ElementKind::Hex8, outer, counts[2])?;
    Ok(Nest {
        coarse: carved(&coarse, |x| !inside(x))?,
        fine: generate(ElementKind::Tet4, outer, counts[1])?,
        mediator: carved(&mediator, |x| !inside(x))?,
        overlap: Arc::new(shell),
        volume: coarse.volume(),
    })
}

fn corner() -> Result<Outcome> {
    let mut out = Outcome::default();
    let cases = [
        (
            "corner",
            nest(
                [[0.0; 3], [3.0; 3]],
                [[0.0; 3], [1.0; 3]],
                [[0.0; 3], [2.0; 3]],
                [[6, 6, 6], [5, 5, 5], [2, 2, 2]],
            )?,
        ),
        (
            "free surface",
            nest(
                [[0.0; 3], [4.0, 4.0, 2.0]],
                [[1.5, 1.5, 1.5], [2.5, 2.5, 2.0]],
                [[1.0, 1.0, 1.0], [3.0, 3.0, 2.0]],
                [[8, 8, 4], [5, 5, 3], [4, 4, 2]],
            )?,
        ),
    ];
    for (name, nest) in cases {
        let weights = Weights::from_weight(Arc::new(Ramp::new(nest.overlap, Profile::Cubic, 0.01)?));
        let bodies = two(nest.coarse, nest.fine, weights)?;
        let mut c = couple(shaken(bodies, 8)?, nest.mediator, 0.0)?;
        out.add(
            format!("relative error of the mass, {name}"),
            (mass(&c) / nest.volume - 1.0).abs(),
            0.0..=2e-3,
        );
        let (before, scale) = (c.momentum(), solid::momentum_scale(&c));
        c.run(200, &mut Silent)?;
        let after = c.momentum();
        for (k, what) in ["linear", "angular"].into_iter().enumerate() {
            out.add(
                format!("change of the {what} momentum, {name}"),
                (after[k] - before[k]).norm() / scale[k],
                0.0..=1e-12,
            );
        }
        out.add(format!("drift, {name}"), c.drift(), 0.0..=1e-11);
    }
    out.add_naive(
        "share of the mass lost in the corner",
        product_defect()?,
        0.1..=0.6,
    );
    Ok(out)
}

fn bored(trim_mediator: bool) -> Result<Coupled<f64>> {
    let solid_part = |x: &Point3<f64>| {
        let in_overlap = x.x > 2.0 && x.x < 3.0;
        let in_bore = (1.0 / 3.0..2.0 / 3.0).contains(&x.y) && (1.0 / 3.0..2.0 / 3.0).contains(&x.z);
        !(in_overlap && in_bore)
    };
    let left = carved(&block(ElementKind::Hex8, [0.0, 3.0], [6, 3, 3])?, solid_part)?;
    let right = carved(&block(ElementKind::Hex8, [2.0, 4.0], [10, 6, 6])?, solid_part)?;
    let space = block(ElementKind::Hex8, solid::OVERLAP, [2, 3, 3])?;
    let space = if trim_mediator {
        carved(&space, solid_part)?
    } else {
        space
    };
    let bodies = two(left, right, solid::weights(Profile::Cubic, 0.01)?)?;
    couple(shaken(bodies, 6)?, space, 0.0)
}

fn hole() -> Result<Outcome> {
    let mut out = Outcome::default();
    let spanned = bored(false);
    if let Err(Error::OverhangingMediator { outside, total, .. }) = &spanned {
        out.add_naive(
            "share of the mediator that holds no material",
            outside / total,
            0.11..=0.112,
        );
    }
    out.add_refusal("a mediator that spans the hole", spanned, |e| {
        matches!(e, Error::OverhangingMediator { .. })
    });
    let mut c = bored(true)?;
    c.run(300, &mut Silent)?;
    out.add("drift", c.drift(), 0.0..=1e-11);
    out.add("velocity jump", c.constraint_residual(), 0.0..=1e-10);
    Ok(out)
}
