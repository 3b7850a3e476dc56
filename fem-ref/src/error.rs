//! Errors of this crate: each names the object, the value, the limit and a way out.

/// What can go wrong while a mesh or a finite element model is made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A parameter has a value that makes no sense.
    #[error("{name} = {value}: {rule}")]
    Parameter {
        /// Name of the parameter.
        name: &'static str,
        /// Its value.
        value: String,
        /// What it must satisfy.
        rule: &'static str,
    },
    /// Nothing to compute on.
    #[error(
        "mesh has {nodes} nodes and {elements} elements; give at least one element and the nodes it refers to"
    )]
    EmptyMesh {
        /// Number of nodes.
        nodes: usize,
        /// Number of elements.
        elements: usize,
    },
    /// The connectivity cannot be cut into elements.
    #[error(
        "connectivity has {found} entries, which is no multiple of the {corners} corners of a {kind}; complete the last element"
    )]
    Connectivity {
        /// Element kind.
        kind: &'static str,
        /// Corners per element.
        corners: usize,
        /// Entries found.
        found: usize,
    },
    /// A coordinate is NaN or infinite.
    #[error("node {node}: coordinate {axis} is {value}, not a finite number; check the input that feeds it")]
    NodeNotFinite {
        /// Node index.
        node: usize,
        /// Axis: x, y or z.
        axis: char,
        /// The value.
        value: f64,
    },
    /// An element refers to a node that does not exist.
    #[error("{kind} element {element} refers to node {index}, but the mesh has nodes 0 to {last} only")]
    NodeIndex {
        /// Element kind.
        kind: &'static str,
        /// Element index.
        element: usize,
        /// The index.
        index: usize,
        /// Largest valid index.
        last: usize,
    },
    /// No element uses a node.
    #[error("node {node} at ({:.6e}, {:.6e}, {:.6e}) m belongs to no element and would have no mass; remove it", point[0], point[1], point[2])]
    UnreferencedNode {
        /// Node index.
        node: usize,
        /// Its position \[m\].
        point: [f64; 3],
    },
    /// Two nodes lie on top of each other.
    #[error("nodes {first} and {second} coincide at ({:.6e}, {:.6e}, {:.6e}) m (distance {distance:.1e} m, limit {limit:.1e} m); merge them", point[0], point[1], point[2])]
    CoincidentNodes {
        /// First node.
        first: usize,
        /// Second node.
        second: usize,
        /// Position of the first \[m\].
        point: [f64; 3],
        /// Distance \[m\].
        distance: f64,
        /// Smallest distance accepted \[m\].
        limit: f64,
    },
    /// Pieces of a mesh touch and share no node.
    #[error("the mesh is in {count} pieces that touch and share no node: {pieces}; nodes {first} and {second} both lie at ({:.6e}, {:.6e}, {:.6e}) m; merge the nodes where the pieces meet (Coherence or fragments of the geometry in Gmsh), or take a mesh of each piece", point[0], point[1], point[2])]
    SeparatePieces {
        /// Number of pieces.
        count: usize,
        /// The pieces: elements, places, volumes.
        pieces: String,
        /// A node of one piece.
        first: usize,
        /// A node of another piece at the same place.
        second: usize,
        /// Their place \[m\].
        point: [f64; 3],
    },
    /// Two elements have the same nodes.
    #[error("{kind} elements {first} and {second} at ({:.6e}, {:.6e}, {:.6e}) m have the same nodes, so that mass and stiffness would count twice there; remove one of them", centre[0], centre[1], centre[2])]
    RepeatedElement {
        /// Element kind.
        kind: &'static str,
        /// First element.
        first: usize,
        /// Second element.
        second: usize,
        /// Mean of the corners \[m\].
        centre: [f64; 3],
    },
    /// An element is turned inside out.
    #[error("{kind} element {element} at ({:.6e}, {:.6e}, {:.6e}) m is inverted: its relative Jacobian is {jacobian:.3e} at corner {corner}, must exceed {limit:.0e}; reverse its node order or repair the mesh", centre[0], centre[1], centre[2])]
    InvertedElement {
        /// Element kind.
        kind: &'static str,
        /// Element index.
        element: usize,
        /// Local corner.
        corner: usize,
        /// Mean of the corners \[m\].
        centre: [f64; 3],
        /// Jacobian over the cube of the longest edge.
        jacobian: f64,
        /// Smallest value accepted.
        limit: f64,
    },
    /// An element has no volume.
    #[error("{kind} element {element} at ({:.6e}, {:.6e}, {:.6e}) m is flat: its relative Jacobian is {jacobian:.3e} at corner {corner}, must exceed {limit:.0e}; remove it or move its nodes", centre[0], centre[1], centre[2])]
    FlatElement {
        /// Element kind.
        kind: &'static str,
        /// Element index.
        element: usize,
        /// Local corner.
        corner: usize,
        /// Mean of the corners \[m\].
        centre: [f64; 3],
        /// Jacobian over the cube of the longest edge (bars: length over the size of the mesh).
        jacobian: f64,
        /// Smallest value accepted.
        limit: f64,
    },
    /// A bar of the axial model is not parallel to x.
    #[error(
        "bar element {element} leaves the x direction by {angle:.3e} rad; the bar model carries axial displacements along x only: turn the mesh"
    )]
    BarDirection {
        /// Element index.
        element: usize,
        /// Angle to the x axis \[rad\].
        angle: f64,
    },
    /// No group has the name.
    #[error("mesh has no group '{name}'; it has: {known}")]
    UnknownGroup {
        /// The name asked for.
        name: String,
        /// Names of the groups.
        known: String,
    },
    /// A group of nodes is asked for its surface.
    #[error("group '{name}' has {nodes} nodes but no facets; name a surface instead")]
    NotASurface {
        /// Name of the group.
        name: String,
        /// Number of its nodes.
        nodes: usize,
    },
    /// A selection found nothing.
    #[error("group '{name}' is empty: no {what} of the mesh satisfies its condition; check it")]
    EmptyGroup {
        /// Name of the group.
        name: String,
        /// What was looked for.
        what: &'static str,
    },
    /// The operation is not made for this element kind.
    #[error("{what} cannot be made of {kind} elements; use {remedy}")]
    Kind {
        /// What was asked for.
        what: &'static str,
        /// Element kind.
        kind: &'static str,
        /// What to use.
        remedy: &'static str,
    },
    /// A file cannot be read.
    #[error("mesh file '{path}' cannot be read: {message}")]
    File {
        /// Path.
        path: String,
        /// Message of the operating system.
        message: String,
    },
    /// A Gmsh file is not understood.
    #[error("Gmsh mesh: {message}")]
    Gmsh {
        /// What is wrong, where, and what to do.
        message: String,
    },
    /// An error of the core.
    #[error(transparent)]
    Core(#[from] arlequin_core::Error),
}

/// Result of this crate's constructors.
pub type Result<V, E = Error> = std::result::Result<V, E>;

/// Shorthand for [`Error::Parameter`].
pub(crate) fn parameter(name: &'static str, value: impl std::fmt::Display, rule: &'static str) -> Error {
    Error::Parameter {
        name,
        value: value.to_string(),
        rule,
    }
}

impl From<Error> for arlequin_core::Error {
    fn from(e: Error) -> Self {
        match e {
            Error::Core(e) => e,
            Error::Parameter { name, value, rule } => arlequin_core::invalid(name, value, rule),
            other => Self::of_model("fem", other),
        }
    }
}
