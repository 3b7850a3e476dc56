//! Errors of this crate. Each one names the object, the value, the limit and a remedy.

/// Errors in making a mesh or a finite element model.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A parameter is out of its range.
    #[error("{name} = {value}: {rule}")]
    Parameter {
        /// Name of the parameter.
        name: &'static str,
        /// Its value.
        value: String,
        /// Condition that it must satisfy.
        rule: &'static str,
    },
    /// The mesh has no nodes or no elements.
    #[error(
        "mesh has {nodes} nodes and {elements} elements; give at least one element and the nodes it refers to"
    )]
    EmptyMesh {
        /// Number of nodes.
        nodes: usize,
        /// Number of elements.
        elements: usize,
    },
    /// The connectivity does not consist of whole elements.
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
    /// A node belongs to no element.
    #[error("node {node} at ({:.6e}, {:.6e}, {:.6e}) m belongs to no element and would have no mass; remove it", point[0], point[1], point[2])]
    UnreferencedNode {
        /// Node index.
        node: usize,
        /// Its position \[m\].
        point: [f64; 3],
    },
    /// Two nodes coincide.
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
    /// Pieces of a mesh touch but share no node.
    #[error("the mesh is in {count} pieces that touch and share no node: {pieces}; nodes {first} and {second} both lie at ({:.6e}, {:.6e}, {:.6e}) m; merge the nodes where the pieces meet (Coherence or fragments of the geometry in Gmsh), or take a mesh of each piece", point[0], point[1], point[2])]
    SeparatePieces {
        /// Number of pieces.
        count: usize,
        /// Description of the pieces: elements, positions, volumes.
        pieces: String,
        /// A node of one piece.
        first: usize,
        /// A node of another piece at the same place.
        second: usize,
        /// Their position \[m\].
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
    /// A bar is not parallel to x, as the axial model requires.
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
        /// The requested name.
        name: String,
        /// Names of the groups.
        known: String,
    },
    /// The surface is requested of a group that has only nodes.
    #[error("group '{name}' has {nodes} nodes but no facets; name a surface instead")]
    NotASurface {
        /// Name of the group.
        name: String,
        /// Number of its nodes.
        nodes: usize,
    },
    /// A selection is empty.
    #[error("group '{name}' is empty: no {what} of the mesh satisfies its condition; check it")]
    EmptyGroup {
        /// Name of the group.
        name: String,
        /// Kind of the selected objects.
        what: &'static str,
    },
    /// The operation is not available for this element kind.
    #[error("{what} cannot be made of {kind} elements; use {remedy}")]
    Kind {
        /// The requested result.
        what: &'static str,
        /// Element kind.
        kind: &'static str,
        /// Kinds that can be used.
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
        /// Description of the fault, its location and a remedy.
        message: String,
    },
    /// An error from the core.
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
