//! Messages with structured content, and how they are written and read.

use crate::error::{Error, Result};
use crate::wire::{Content, Kind, Message, NAME};
use arlequin_core::geometry::{Cell, Polyhedron};
use arlequin_core::nalgebra::Point3;
use arlequin_core::snapshot::Record;
use arlequin_core::{DofLayout, Share, Weight, Weights};

/// Set of quantities as bits: what a solver offers, what a message requests, or what a message contains.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Fields(pub u32);

impl Fields {
    /// Velocities.
    pub const VELOCITIES: Self = Self(1);
    /// Displacements.
    pub const DISPLACEMENTS: Self = Self(2);
    /// Accelerations.
    pub const ACCELERATIONS: Self = Self(4);
    /// Energy that the solver's own time stepping conserves.
    pub const INVARIANT: Self = Self(8);
    /// The solver can be saved and restored; used in offers only.
    pub const MEMORY: Self = Self(16);
    /// Velocities and displacements, which every solver must offer.
    pub const MOTION: Self = Self(3);

    /// Returns whether this set contains all of `fields`.
    pub fn has(self, fields: Self) -> bool {
        self.0 & fields.0 == fields.0
    }

    /// Returns the union of both sets.
    #[must_use]
    pub fn and(self, others: Self) -> Self {
        Self(self.0 | others.0)
    }

    /// Returns the intersection of both sets.
    #[must_use]
    pub fn among(self, others: Self) -> Self {
        Self(self.0 & others.0)
    }
}

/// Kind of element in a solver's mesh, with nodes in the order of Gmsh and VTK.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Element {
    /// Lines of two nodes.
    Line,
    /// Tetrahedra of four nodes.
    Tetrahedron,
    /// Hexahedra of eight nodes.
    Hexahedron,
}

impl Element {
    /// Returns the number of nodes of an element.
    pub fn nodes(self) -> usize {
        match self {
            Self::Line => 2,
            Self::Tetrahedron => 4,
            Self::Hexahedron => 8,
        }
    }
}

/// Geometry of a solver as an interface uses it: positions and shape functions.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    /// Particles: values exist at the nodes only. Gradients come from pairs of neighbours.
    Particles {
        /// Volume that each node represents \[m³\].
        volumes: Vec<f64>,
        /// Pairs of neighbours; empty if there are no gradients.
        pairs: Vec<[u32; 2]>,
    },
    /// Linear elements.
    Mesh {
        /// Kind of all elements.
        element: Element,
        /// Nodes of the elements, one element after another.
        connectivity: Vec<u32>,
        /// Cross-section of lines \[m²\].
        section: f64,
    },
}

/// Description that a solver sends in answer to the greeting.
#[derive(Debug, Clone, PartialEq)]
pub struct Description {
    /// Longest message it accepts \[bytes\].
    pub limit: u64,
    /// Quantities it offers.
    pub offers: Fields,
    /// Name of the solver, for error messages.
    pub name: String,
    /// Kind of the solver, for reports.
    pub kind: String,
    /// Numbers of nodes, displacements and rotations.
    pub layout: DofLayout,
    /// Reference positions \[m\].
    pub nodes: Vec<Point3<f64>>,
    /// Geometry that interfaces use.
    pub shape: Shape,
    /// Lumped inertia of every unknown without weights \[kg, kg m²\].
    pub inertia: Vec<f64>,
    /// Critical step without weights \[s\]; infinite if every step is stable.
    pub critical_step: f64,
}

impl Description {
    /// Writes the description to a message.
    pub fn write(&self, message: &mut Message) {
        message
            .begin(Kind::Description)
            .u64(self.limit)
            .u32(self.offers.0);
        let (number, section, parts) = match &self.shape {
            Shape::Particles { pairs, .. } => (0, 1.0, pairs.len()),
            Shape::Mesh {
                element,
                connectivity,
                section,
            } => (*element as u8 + 1, *section, connectivity.len() / element.nodes()),
        };
        let DofLayout {
            nodes,
            components,
            rotations,
        } = self.layout;
        message
            .raw(&[components as u8, rotations as u8, number, 0])
            .u64(nodes as u64)
            .u64(parts as u64)
            .f64(section)
            .f64(self.critical_step)
            .text(&self.name, NAME)
            .text(&self.kind, NAME);
        self.nodes.iter().for_each(|x| {
            message.numbers(x.coords.as_slice());
        });
        message.numbers(&self.inertia);
        match &self.shape {
            Shape::Particles { volumes, pairs } => {
                message.numbers(volumes);
                pairs.iter().flatten().for_each(|k| {
                    message.u32(*k);
                });
            }
            Shape::Mesh { connectivity, .. } => connectivity.iter().for_each(|k| {
                message.u32(*k);
            }),
        }
    }

    /// Reads a description.
    ///
    /// # Errors
    /// [`Error::Length`], [`Error::Content`].
    pub fn read(mut content: Content<'_>) -> Result<Self> {
        let (limit, offers) = (content.u64()?, Fields(content.u32()?));
        if !offers.has(Fields::MOTION) {
            return Err(
                content.wrong("velocities or displacements are not offered; every solver must tell both")
            );
        }
        let [components, rotations, number, _] = [content.u8()?, content.u8()?, content.u8()?, content.u8()?];
        if !matches!(components, 1..=3) || !matches!(rotations, 0 | 3) {
            let rule = format!(
                "nodes have {components} displacements and {rotations} rotations; 1 to 3 and 0 or 3 they have"
            );
            return Err(content.wrong(rule));
        }
        let element = match number {
            0 => None,
            1 => Some(Element::Line),
            2 => Some(Element::Tetrahedron),
            3 => Some(Element::Hexahedron),
            _ => return Err(content.wrong(format!("the shape is {number}; 0 to 3 there are"))),
        };
        let per_node = 8 * (3 + usize::from(components) + usize::from(rotations));
        // Counts are checked against the bytes that each node or element needs, before anything is allocated.
        let nodes = content.count("nodes", per_node)?;
        if nodes == 0 {
            return Err(content.wrong("there is no node"));
        }
        let parts = content.count("elements or pairs", 4 * element.map_or(2, Element::nodes))?;
        let section = content.finite("the cross-section")?;
        let critical_step = content.f64()?;
        check_step(&content, critical_step)?;
        let (name, kind) = (content.text("the name", NAME)?, content.text("the kind", NAME)?);
        let layout = DofLayout {
            nodes,
            components: usize::from(components),
            rotations: usize::from(rotations),
        };
        let positions = content.vector("positions", 3 * nodes)?;
        let inertia = content.vector("inertia", layout.dofs())?;
        check_inertia(&content, &inertia)?;
        let shape = read_shape(&mut content, element, [nodes, parts], section)?;
        // Bytes that are left mean another layout.
        content.end()?;
        let (positions, _) = positions.as_chunks::<3>();
        Ok(Self {
            limit,
            offers,
            name,
            kind,
            layout,
            nodes: positions.iter().map(|x| Point3::from(*x)).collect(),
            shape,
            inertia,
            critical_step,
        })
    }
}

fn read_shape(
    content: &mut Content<'_>,
    element: Option<Element>,
    [nodes, parts]: [usize; 2],
    section: f64,
) -> Result<Shape> {
    let volumes = match element {
        None => content.vector("volumes", nodes)?,
        Some(_) => Vec::new(),
    };
    let ends = content.integers(parts * element.map_or(2, Element::nodes))?;
    // An interface would index with these numbers.
    if let Some(beyond) = ends.iter().find(|k| **k as usize >= nodes) {
        return Err(content.wrong(format!("an element or pair names node {beyond} of {nodes}")));
    }
    Ok(match element {
        None => Shape::Particles {
            volumes,
            pairs: ends.as_chunks::<2>().0.to_vec(),
        },
        Some(element) => Shape::Mesh {
            element,
            connectivity: ends,
            section,
        },
    })
}

pub(crate) fn check_step(content: &Content<'_>, step: f64) -> Result<()> {
    // Not `<= 0`: a NaN must be refused, too.
    if step > 0.0 {
        return Ok(());
    }
    Err(content.wrong(format!(
        "the critical step is {step} s; it is positive, or infinite for a solver that takes any"
    )))
}

pub(crate) fn check_inertia(content: &Content<'_>, inertia: &[f64]) -> Result<()> {
    match inertia.iter().position(|m| *m < 0.0) {
        None => Ok(()),
        Some(unknown) => Err(content.wrong(format!(
            "the inertia of unknown {unknown} is {:e}, below zero",
            inertia[unknown]
        ))),
    }
}

/// Places at which a solver requests a weight.
#[derive(Debug, Clone)]
pub enum Places {
    /// Requests the value at each point.
    Points(Vec<Point3<f64>>),
    /// Requests the mean over each cell.
    Cells(Vec<Cell<f64>>),
}

/// Request for weights.
#[derive(Debug, Clone)]
pub struct Ask {
    /// The energy whose weight is requested.
    pub share: Share,
    /// Points or cells at which it is requested.
    pub places: Places,
}

/// Codes of [`Places`] in messages: points, and cells by their form.
const POINTS: u8 = 0;
const SEGMENTS: u8 = 1;
const TETRAHEDRA: u8 = 2;
const HEXAHEDRA: u8 = 3;
const POLYHEDRA: u8 = 4;

impl Ask {
    /// Writes a request for the value at a point.
    pub fn write_point(message: &mut Message, share: Share, x: &Point3<f64>) {
        begin_ask(message, share, POINTS, 1.0);
        message.numbers(x.coords.as_slice());
    }

    /// Writes a request for the mean over a cell.
    pub fn write_cell(message: &mut Message, share: Share, cell: &Cell<f64>) {
        match cell {
            Cell::Segment { ends, section } => {
                begin_ask(message, share, SEGMENTS, *section);
                ends.iter().for_each(|x| {
                    message.numbers(x.coords.as_slice());
                });
            }
            Cell::Polyhedron(p) => {
                begin_ask(message, share, POLYHEDRA, 1.0);
                message.u32(p.faces.len() as u32);
                for face in &p.faces {
                    message.u32(face.len() as u32);
                    face.iter().for_each(|x| {
                        message.numbers(x.coords.as_slice());
                    });
                }
            }
        }
    }

    /// Reads a request.
    ///
    /// # Errors
    /// [`Error::Length`], [`Error::Content`].
    pub fn read(mut content: Content<'_>) -> Result<Self> {
        let share = match content.u8()? {
            0 => Share::Internal,
            1 => Share::Kinetic,
            2 => Share::External,
            other => return Err(content.wrong(format!("weight {other} is asked for; 0 to 2 there are"))),
        };
        let (kind, _, _) = (content.u8()?, content.u8()?, content.u8()?);
        let count = content.u32()? as usize;
        let section = content.finite("the cross-section")?;
        let corners = match kind {
            POINTS => 1,
            SEGMENTS => 2,
            TETRAHEDRA => 4,
            HEXAHEDRA => 8,
            POLYHEDRA => 0,
            _ => return Err(content.wrong(format!("places of kind {kind} are asked for; 0 to 4 there are"))),
        };
        // Polyhedra have any number of corners: their own counts follow in the message.
        let places = if corners == 0 {
            Places::Cells(polyhedra(&mut content, count)?)
        } else {
            let points = points(&mut content, count.saturating_mul(corners))?;
            match kind {
                POINTS => Places::Points(points),
                SEGMENTS => {
                    let (ends, _) = points.as_chunks::<2>();
                    let cell = |ends: &[Point3<f64>; 2]| Cell::Segment { ends: *ends, section };
                    Places::Cells(ends.iter().map(cell).collect())
                }
                TETRAHEDRA => {
                    let (groups, _) = points.as_chunks::<4>();
                    let cell = |p: &[Point3<f64>; 4]| Cell::Polyhedron(Polyhedron::tetrahedron(*p));
                    Places::Cells(groups.iter().map(cell).collect())
                }
                _ => {
                    let (groups, _) = points.as_chunks::<8>();
                    let cell = |p: &[Point3<f64>; 8]| Cell::Polyhedron(Polyhedron::hexahedron(*p));
                    Places::Cells(groups.iter().map(cell).collect())
                }
            }
        };
        content.end()?;
        Ok(Self { share, places })
    }

    /// Returns the number of places.
    pub fn count(&self) -> usize {
        match &self.places {
            Places::Points(p) => p.len(),
            Places::Cells(c) => c.len(),
        }
    }

    /// Writes the answer to this request.
    pub fn answer(&self, weights: &Weights<f64>, message: &mut Message) {
        let weight: &dyn Weight<f64> = match self.share {
            Share::Internal => &*weights.internal,
            Share::Kinetic => &*weights.kinetic,
            Share::External => &*weights.external,
        };
        message.begin(Kind::Shares);
        match &self.places {
            Places::Points(points) => points.iter().for_each(|x| {
                message.f64(weight.value(x));
            }),
            Places::Cells(cells) => cells.iter().for_each(|c| {
                message.f64(weight.mean(c));
            }),
        }
    }
}

fn begin_ask(message: &mut Message, share: Share, kind: u8, section: f64) {
    let share = match share {
        Share::Internal => 0,
        Share::Kinetic => 1,
        Share::External => 2,
    };
    message
        .begin(Kind::Ask)
        .raw(&[share, kind, 0, 0])
        .u32(1)
        .f64(section);
}

fn points(content: &mut Content<'_>, count: usize) -> Result<Vec<Point3<f64>>> {
    let flat = content.vector("points", count.saturating_mul(3))?;
    Ok(flat.as_chunks::<3>().0.iter().map(|x| Point3::from(*x)).collect())
}

/// Reads polyhedra.
fn polyhedra(content: &mut Content<'_>, count: usize) -> Result<Vec<Cell<f64>>> {
    // The announced counts allocate nothing: each cell and each face takes at least four bytes of the
    // message, so that a wrong count ends the reading.
    let mut out = Vec::new();
    for _ in 0..count {
        let faces = content.u32()?;
        let mut p = Polyhedron::default();
        for _ in 0..faces {
            let corners = content.u32()? as usize;
            if corners < 3 {
                return Err(content.wrong(format!("a face has {corners} corners")));
            }
            p.faces.push(points(content, corners)?);
        }
        if p.faces.len() < 4 {
            return Err(content.wrong(format!("a polyhedron has {} faces", p.faces.len())));
        }
        out.push(Cell::Polyhedron(p));
    }
    Ok(out)
}

/// Writes the state that a solver saves, as [`Kind::Record`] or [`Kind::Restore`].
pub fn write_record(message: &mut Message, kind: Kind, record: &Record<f64>) {
    message
        .begin(kind)
        .u64(record.numbers.len() as u64)
        .u64(record.integers.len() as u64)
        .numbers(&record.numbers);
    record.integers.iter().for_each(|k| {
        message.u64(*k);
    });
}

/// Reads a saved state. The numbers may have any value, also NaN: they are the solver's own.
///
/// # Errors
/// [`Error::Length`], [`Error::Content`].
pub fn read_record(mut content: Content<'_>) -> Result<Record<f64>> {
    let numbers = content.count("numbers", 8)?;
    let integers = content.count("integers", 8)?;
    let record = Record {
        numbers: content
            // By their bits: a NaN of the solver's own keeps its value.
            .long_integers(numbers)?
            .into_iter()
            .map(f64::from_bits)
            .collect(),
        integers: content.long_integers(integers)?,
    };
    content.end()?;
    Ok(record)
}

/// Reads the text of [`Kind::Failed`] as an error.
pub(crate) fn read_failure(mut content: Content<'_>, peer: &str) -> Result<Error> {
    let limit = crate::wire::SMALL as usize;
    let text = content.text("the reason", limit)?;
    content.end()?;
    let peer = peer.to_owned();
    Ok(Error::Failed { peer, text })
}
