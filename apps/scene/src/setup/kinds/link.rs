//! `kind = "link"`: an external solver in another process as a body.

use crate::error::{Error, Result, core, fem, key, value};
use crate::setup::body::Body;
use crate::setup::clock::SetupClock;
use crate::setup::kind::{Feature, Kind, Order, WHOLE};
use crate::setup::mesh::Grid;
use crate::setup::{BodyShape, LoweredModel, LoweredScene};
use crate::spec::Shape;
use arlequin::core::geometry::bounds_of;
use arlequin::core::nalgebra::Point3;
use arlequin::core::{self as arlequin_core, Interpolation, Outline, Participant, ParticleField};
use arlequin::fem_ref::{ElementKind, FemField, Mesh};
use arlequin_link::{Address, Element, Options, Remote, Shape as LinkShape};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// Longest timeout \[s\]: a year.
const LONGEST: f64 = 3.2e7;

/// A solver in another process.
pub(super) struct Link;

impl Kind for Link {
    fn name(&self) -> &'static str {
        "link"
    }

    fn meaning(&self) -> &'static str {
        "A solver in another process, which has its own nodes, masses and steps; needs `command` or `address`,\n\
         and takes neither `shape` nor `material`."
    }

    fn is_remote(&self) -> bool {
        true
    }

    fn refusal(&self, feature: Feature) -> Option<&'static str> {
        match feature {
            Feature::Crack => Some("a link brings its own body; cut it there"),
            Feature::Zone => Some(
                "a zone is filled here, and a link brings its own body; write [model.NAME] and [interface.NAME]",
            ),
            Feature::Partition => Some(WHOLE),
            Feature::Volumes | Feature::CoarseSide | Feature::Sleep => None,
        }
    }

    fn check(&self, order: &Order<'_>) -> Result<()> {
        check(order.key, order.table)
    }

    /// Refuses `[static]`.
    fn check_in(&self, scene: &LoweredScene, order: &Order<'_>) -> Result<()> {
        if scene.statics.is_none() {
            return Ok(());
        }
        let name = order.name;
        let rule = format!(
            "model '{name}' is a link, which steps by itself from the start on; remove static, or the link"
        );
        Err(key("static", rule))
    }

    fn build(&self, order: &Order<'_>, _: &mut SetupClock<'_>) -> Result<Body> {
        body(order.name, order.key, order.table, order.folder)
    }
}

/// Describes the program that a link starts or the address at which it waits.
pub(crate) fn link_of(table: &LoweredModel) -> String {
    let command = table.command.as_deref().map(arlequin_link::shown);
    match (command, &table.address) {
        (Some(command), _) => format!("starts {command}"),
        (None, Some(address)) => format!("waits at {address}"),
        (None, None) => "names nothing".into(),
    }
}

/// Refuses keys of a link in other kinds of models.
pub(super) fn check_keys(path: &str, table: &LoweredModel) -> Result<()> {
    let link_keys = [
        ("command", table.command.is_some()),
        ("address", table.address.is_some()),
        ("timeout", table.timeout.is_some()),
        ("start_timeout", table.start_timeout.is_some()),
    ];
    match link_keys.iter().find(|k| k.1) {
        None => Ok(()),
        Some((name, _)) => Err(key(format!("{path}.{name}"), "is for kind = \"link\"; remove it")),
    }
}

/// Refuses keys that only other kinds have, and a link without exactly one end.
fn check(path: &str, table: &LoweredModel) -> Result<()> {
    let of_others = [
        ("shape", table.shape.in_scene().is_some()),
        ("material", table.material.is_some()),
        ("spacing", table.spacing.is_some()),
        ("divisions", table.divisions.is_some()),
        ("scale", (table.scale - 1.0).abs() > 0.0),
        ("volume", table.volume.is_some()),
        ("materials", !table.materials.is_empty()),
    ];
    if let Some((name, _)) = of_others.iter().find(|k| k.1) {
        let rule = "is the business of the program behind the link; remove it";
        return Err(key(format!("{path}.{name}"), rule));
    }
    match (&table.command, &table.address) {
        (Some(c), None) if c.is_empty() => Err(key(
            format!("{path}.command"),
            "names no program; write command = [\"python3\", \"solver.py\"]",
        )),
        (Some(_), None) => Ok(()),
        (None, Some(_)) => address(path, table).map(|_| ()),
        _ => Err(key(
            path,
            "a link needs exactly one of command = [\"program\", \"argument\"], address = \"unix:PATH\"",
        )),
    }?;
    for (name, limit, default) in [
        ("timeout", table.timeout, 4),
        ("start_timeout", table.start_timeout, 30),
    ] {
        if let Some(t) = limit.filter(|t| !(*t > 0.0 && *t < LONGEST)) {
            let rule = format!("must be positive [s], and at most a year; the default is {default}");
            return Err(value(format!("{path}.{name}"), t, &rule));
        }
    }
    Ok(())
}

fn address(path: &str, table: &LoweredModel) -> Result<Address> {
    let text = table.address.as_deref().unwrap_or_default();
    text.parse().map_err(|e: arlequin_link::Error| {
        let rule = match e {
            arlequin_link::Error::Address { rule, .. } => rule,
            error => error.to_string(),
        };
        value(format!("{path}.address"), text, &rule)
    })
}

/// Starts or awaits the external solver and builds a body from the description it sends.
fn body(name: &str, path: &str, table: &LoweredModel, folder: &Path) -> Result<Body> {
    let mut options = Options::default();
    options.timeout = table.timeout.map_or(options.timeout, Duration::from_secs_f64);
    let start = table.start_timeout.map(Duration::from_secs_f64);
    // A program that may take long to answer may take as long to start.
    options.start = start.unwrap_or(options.start.max(options.timeout));
    let remote = match &table.command {
        Some(command) => Remote::start(name, command, folder, options),
        None => Remote::await_at(name, &address(path, table)?, options),
    };
    let solver = remote.map_err(|e| failed(path, name, e))?;
    let (field, grid, shape): (Arc<dyn Interpolation<f64>>, _, _) = match solver.shape() {
        LinkShape::Particles { volumes, pairs } => particles(path, solver.nodes(), volumes, pairs)?,
        LinkShape::Mesh {
            element,
            connectivity,
            section,
        } => {
            let mesh = Mesh::new(kind_of(*element), solver.nodes().to_vec(), connectivity.clone());
            let mesh = mesh.and_then(|m| m.with_section(*section)).map_err(fem(path))?;
            let grid = Grid::of_mesh(&mesh);
            let shape = extent(solver.nodes(), (*element == Element::Line).then_some(*section));
            (Arc::new(FemField::new(mesh)), grid, shape)
        }
    };
    Ok(Body {
        // An outline without forces, needed only until the run takes over the solver.
        model: Box::new(Outline::new(&solver, solver.description().inertia.clone())),
        spacing: spacing(&grid),
        groups: groups(&solver),
        field,
        grid: Arc::new(grid),
        surfaces: BTreeMap::new(),
        boundary: Vec::new(),
        material: None,
        materials: None,
        shape: BodyShape::Given(shape),
        grains: None,
        warnings: Vec::new(),
        solver: Some(Box::new(solver)),
    })
}

fn failed(path: &str, name: &str, e: arlequin_link::Error) -> Error {
    core(path)(arlequin_core::Error::of_model(name, e))
}

fn kind_of(element: Element) -> ElementKind {
    match element {
        Element::Line => ElementKind::Bar2,
        Element::Tetrahedron => ElementKind::Tet4,
        Element::Hexahedron => ElementKind::Hex8,
    }
}

/// Field, mesh for output and extent of particles.
type Parts = (Arc<dyn Interpolation<f64>>, Grid, Shape);

fn particles(path: &str, nodes: &[Point3<f64>], volumes: &[f64], pairs: &[[u32; 2]]) -> Result<Parts> {
    let field = ParticleField::new(nodes.to_vec(), volumes).map_err(core(path))?;
    let field = if pairs.is_empty() {
        field
    } else {
        field.with_gradients(pairs).map_err(core(path))?
    };
    // Radius of a ball of the given volume.
    let third = 0.75 / std::f64::consts::PI;
    let grid = Grid {
        points: nodes.to_vec(),
        connectivity: pairs.iter().flatten().copied().collect(),
        corners: 2,
        cell_type: 3,
        radii: volumes.iter().map(|v| (v * third).cbrt()).collect(),
    };
    Ok((Arc::new(field), grid, extent(nodes, None)))
}

/// Bounding box of the nodes, or the line they lie on, from which a mediator is derived. If the body fills
/// less than its box, the set-up reports that the mediator sticks out of it.
fn extent(nodes: &[Point3<f64>], section: Option<f64>) -> Shape {
    let [low, high] = bounds_of(nodes.iter());
    match section {
        Some(section) => Shape::Bar {
            from: low.x,
            to: high.x,
            section,
        },
        None => Shape::Box {
            low: low.coords.into(),
            high: high.coords.into(),
            hole: None,
        },
    }
}

/// Mean length of an edge or bond; twice the mean radius for particles without bonds \[m\].
fn spacing(grid: &Grid) -> f64 {
    if grid.connectivity.is_empty() {
        return 2.0 * grid.radii.iter().sum::<f64>() / grid.radii.len().max(1) as f64;
    }
    let ends = grid.connectivity.chunks_exact(grid.corners);
    let lengths = ends.map(|e| (grid.points[e[1] as usize] - grid.points[e[0] as usize]).norm());
    lengths.sum::<f64>() / grid.cells() as f64
}

/// Groups of the two ends of a line, for probes.
fn groups(solver: &Remote) -> BTreeMap<String, Vec<usize>> {
    let line = matches!(
        solver.shape(),
        LinkShape::Mesh {
            element: Element::Line,
            ..
        }
    );
    if !line {
        return BTreeMap::new();
    }
    let x = |k: &usize| solver.nodes()[*k].x;
    let nodes = 0..solver.nodes().len();
    // By position: solvers may number the nodes of a line in any order.
    let first = nodes.clone().min_by(|a, b| x(a).total_cmp(&x(b)));
    let last = nodes.max_by(|a, b| x(a).total_cmp(&x(b)));
    let ends = [("x-min", first), ("x-max", last)];
    ends.into_iter()
        .map(|(n, k)| (n.to_owned(), k.into_iter().collect()))
        .collect()
}
