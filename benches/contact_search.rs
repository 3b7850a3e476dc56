//! Search for contacts between a layer of spheres and a plate: seconds per step in which the lists are built
//! anew and all feet are found, for a tenth and the whole of the given size, and the ratio per sphere.
//!
//! `cargo bench --bench contact_search [spheres]`; default a million spheres on a million facets. The layer
//! slides along the plate without touching it, so far in each step that every second step searches.
#![allow(clippy::print_stdout, reason = "a bench talks to a person")]

use arlequin::core::contact::{ContactLaw, Exterior, SurfaceContact};
use arlequin::core::effect::PairSpec;
use arlequin::core::nalgebra::Point3;
use arlequin::core::{
    Boundary, Coupled, DofLayout, Error, Interpolation, Model, Parts, Result, ShapeRow, Silent, Subdomain,
    TimeStep, Views, Weight, Weights,
};
use std::sync::Arc;
use std::time::Instant;

/// Steps that are timed; half of them search.
const STEPS: usize = 8;

/// Nodes without forces, with the faces of their surface or as spheres.
struct Cloud {
    name: &'static str,
    nodes: Vec<Point3<f64>>,
    faces: Option<Vec<[u32; 4]>>,
}

impl Model<f64> for Cloud {
    fn name(&self) -> &str {
        self.name
    }
    fn kind(&self) -> &str {
        "cloud"
    }
    fn layout(&self) -> DofLayout {
        DofLayout {
            nodes: self.nodes.len(),
            components: 3,
            rotations: if self.faces.is_none() { 3 } else { 0 },
        }
    }
    fn nodes(&self) -> &[Point3<f64>] {
        &self.nodes
    }
    fn lumped_inertia(&self, _: &dyn Weight<f64>, out: &mut [f64]) -> Result<()> {
        out.fill(1.0);
        Ok(())
    }
    fn set_internal_weight(&mut self, _: &dyn Weight<f64>) -> Result<()> {
        Ok(())
    }
    fn add_internal_forces(&mut self, _: &[f64], _: &mut [f64]) -> Result<()> {
        Ok(())
    }
    fn internal_energy(&self, _: &[f64]) -> f64 {
        0.0
    }
    fn critical_step(&mut self, _: &[f64]) -> Result<f64> {
        Ok(f64::INFINITY)
    }
    fn views(&self) -> Views<'_, f64> {
        let mut views = Views::default();
        views.surface = self.faces.is_some().then_some(self as _);
        views
    }
}

impl Boundary for Cloud {
    fn faces(&self) -> Vec<[u32; 4]> {
        self.faces.clone().unwrap_or_default()
    }
}

/// The field of a cloud: none between its nodes.
struct Nodes(Vec<Point3<f64>>);

impl Interpolation<f64> for Nodes {
    fn nodes(&self) -> &[Point3<f64>] {
        &self.0
    }
    fn shape_at(&self, x: &Point3<f64>, _: bool, _: &mut ShapeRow<f64>) -> Result<()> {
        Err(Error::OutsideDomain {
            point: x.coords.into(),
            role: "bench".into(),
        })
    }
}

fn subdomain(model: Cloud) -> Subdomain<f64> {
    let field = Arc::new(Nodes(model.nodes.clone()));
    Subdomain::new(Box::new(model), field, Weights::uncoupled())
}

/// A plate of `n` by `n` square faces on each side, one thick, with its top at z = 0.
fn plate(n: usize) -> Cloud {
    let row = n + 1;
    let node = |i: usize, j: usize, k: usize| (k * row * row + j * row + i) as u32;
    let place = |m: usize| {
        let (k, j, i) = (m / (row * row), m / row % row, m % row);
        Point3::new(i as f64, j as f64, k as f64 - 1.0)
    };
    let mut faces = Vec::new();
    for j in 0..n {
        for i in 0..n {
            let quad = |k: usize| {
                [
                    node(i, j, k),
                    node(i + 1, j, k),
                    node(i + 1, j + 1, k),
                    node(i, j + 1, k),
                ]
            };
            let [a, b, c, d] = quad(0);
            faces.extend([[d, c, b, a], quad(1)]);
        }
        let side = |a: [usize; 2], b: [usize; 2]| {
            let [(a, top_a), (b, top_b)] = [a, b].map(|[i, j]| (node(i, j, 0), node(i, j, 1)));
            [a, b, top_b, top_a]
        };
        faces.extend([
            side([j, 0], [j + 1, 0]),
            side([j + 1, n], [j, n]),
            side([0, j + 1], [0, j]),
            side([n, j], [n, j + 1]),
        ]);
    }
    Cloud {
        name: "plate",
        nodes: (0..2 * row * row).map(place).collect(),
        faces: Some(faces),
    }
}

/// Returns the numbers of spheres and facets, and the seconds per search.
fn measure(spheres: usize) -> Result<[f64; 3]> {
    // Eight quarters of squares for each square of the plate.
    let n = (spheres as f64 / 8.0).sqrt().round() as usize;
    let edge = (spheres as f64).sqrt().round() as usize;
    let spacing = n as f64 / (edge + 1) as f64;
    let radius = 0.5 * spacing;
    let centre = |k: usize| {
        let along_edge = |m: usize| (m + 1) as f64 * spacing;
        Point3::new(along_edge(k % edge), along_edge(k / edge), 1.1 * radius)
    };
    let layer = Cloud {
        name: "layer",
        nodes: (0..edge * edge).map(centre).collect(),
        faces: None,
    };
    let plate = plate(n);
    let surface = Exterior::surface(&plate);
    let balls: Vec<[f64; 4]> = layer.nodes.iter().map(|x| [x.x, x.y, x.z, radius]).collect();
    let facets = 4 * plate.faces.as_ref().map_or(0, Vec::len);
    let law = ContactLaw::elastic(1.0);
    let Some(surface) = surface else {
        return Ok([0.0; 3]);
    };
    let contact = SurfaceContact::new(&surface, &Exterior::spheres("layer", &balls), law)?;
    // Two steps cover the skin.
    let (dt, way) = (1e-3, 0.6 * law.skin * radius);
    let dofs = layer.layout().dofs();
    let velocity = (0..dofs).map(|o| f64::from(u8::from(o < dofs / 2 && o % 3 == 0)) * way / dt);
    let layer = subdomain(layer).with_initial(vec![0.0; dofs], velocity.collect())?;
    let parts = Parts {
        start: 0.0,
        end: None,
        subdomains: vec![subdomain(plate), layer],
        interfaces: Vec::new(),
        pairs: vec![PairSpec {
            sides: [0, 1],
            effect: Box::new(contact),
        }],
    };
    let mut run = Coupled::from_parts(parts, TimeStep::Unchecked(dt), None)?;
    let searches = |run: &Coupled<f64>| -> f64 {
        let lines = run.effects();
        let facts = lines.iter().flat_map(|l| &l.facts);
        facts.filter(|f| f.0 == "neighbour searches").map(|f| f.1).sum()
    };
    let (before, begin) = (searches(&run), Instant::now());
    run.run(STEPS, &mut Silent)?;
    let seconds = begin.elapsed().as_secs_f64();
    Ok([
        (edge * edge) as f64,
        facets as f64,
        seconds / (searches(&run) - before),
    ])
}

fn main() -> Result<()> {
    // Started as a test or to be listed, the program shows nothing.
    if !std::env::args().any(|a| a == "--bench") {
        return Ok(());
    }
    let wanted = std::env::args().find_map(|a| a.parse::<usize>().ok());
    let largest = wanted.unwrap_or(1_000_000);
    let mut per_sphere = [0.0; 2];
    for (cost, size) in per_sphere.iter_mut().zip([largest / 10, largest]) {
        let [spheres, facets, seconds] = measure(size)?;
        *cost = seconds / spheres;
        println!(
            "{spheres:>9} spheres on {facets:>9} facets: {seconds:.3} s per search, {:.0} ns per sphere",
            1e9 * *cost
        );
    }
    println!(
        "ten times as many cost {:.2} times as much per sphere",
        per_sphere[1] / per_sphere[0]
    );
    Ok(())
}
