//! Errors of this crate, each with the relevant numbers and a remedy.

/// Result of this crate's functions.
pub type Result<V, E = Error> = std::result::Result<V, E>;

/// Failure of a construction or of a query.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A coordinate is NaN or infinite.
    #[error("node {node} has the coordinates {point:?}, which are not finite; remove or repair it")]
    NonFinite {
        /// Index of the first node with such a coordinate.
        node: usize,
        /// Coordinates of the node.
        point: [f64; 3],
    },
    /// Fewer than four distinct nodes.
    #[error("{found} distinct nodes were given, at least 4 are needed to span a volume")]
    TooFewNodes {
        /// Number of distinct nodes.
        found: usize,
    },
    /// All nodes lie on one straight line, exactly or up to the round-off of their coordinates.
    #[error("all {nodes} nodes lie on one straight line; add nodes off the line to span a volume")]
    AllCollinear {
        /// Number of nodes.
        nodes: usize,
    },
    /// All nodes lie in one plane, exactly or up to the round-off of their coordinates.
    #[error("all {nodes} nodes lie in one plane; add nodes off the plane to span a volume")]
    AllCoplanar {
        /// Number of nodes.
        nodes: usize,
    },
    /// Two nodes have the same coordinates.
    #[error(
        "nodes {first} and {second} coincide at {point:?} ({count} duplicates in all); \
         remove them or build with Delaunay::merging_duplicates"
    )]
    DuplicateNodes {
        /// The first node at this position.
        first: usize,
        /// The node with the same coordinates.
        second: usize,
        /// Common position of both nodes \[m\].
        point: [f64; 3],
        /// Number of nodes that repeat an earlier one.
        count: usize,
    },
    /// Two nodes are closer to each other than the round-off of coordinates of this size.
    #[error(
        "nodes {first} and {second} are {distance:e} m apart, which coordinates of this size do not resolve \
         (limit {tolerance:e} m); merge them, or move the body to the origin"
    )]
    NodesTooClose {
        /// One node.
        first: usize,
        /// The other node.
        second: usize,
        /// Distance between both nodes \[m\].
        distance: f64,
        /// Smallest distance accepted \[m\].
        tolerance: f64,
    },
    /// More nodes or tetrahedra than 32-bit indices can name.
    #[error("{nodes} nodes exceed the limit of {limit} for 32-bit indices; split the model")]
    TooManyNodes {
        /// Number of nodes given.
        nodes: usize,
        /// Largest number of nodes supported.
        limit: usize,
    },
    /// A face or element names a node that does not exist.
    #[error("face {face} names node {node}, but there are only {nodes} nodes")]
    UnknownNode {
        /// Index of the face (or element) in its list.
        face: usize,
        /// The index given for the node.
        node: usize,
        /// Number of nodes.
        nodes: usize,
    },
    /// A face has no area.
    #[error("face {face} with nodes {nodes:?} has no area; remove it from the surface")]
    FlatFace {
        /// Index of the face in its list.
        face: usize,
        /// Nodes of the face.
        nodes: [usize; 3],
    },
    /// Two faces have the same three nodes.
    #[error("faces {first} and {second} have the same nodes {nodes:?}; keep one of them")]
    RepeatedFace {
        /// First face.
        first: usize,
        /// Second face.
        second: usize,
        /// Nodes of both faces.
        nodes: [usize; 3],
    },
    /// The boundary surface does not enclose a volume.
    #[error(
        "the boundary surface is open: edge {edge:?} belongs to {faces} faces, an even number is needed \
         ({open_edges} such edges in all); close the surface or give the faces as crack faces"
    )]
    OpenSurface {
        /// Nodes of the first open edge.
        edge: [usize; 2],
        /// Number of faces at that edge.
        faces: usize,
        /// Number of open edges.
        open_edges: usize,
    },
    /// Two constrained faces cross each other.
    #[error(
        "constrained faces {first} and {second} intersect ({count} pairs in all); \
         cut the surface along the intersection or separate the faces"
    )]
    SelfIntersection {
        /// First face (boundary faces first, then crack faces).
        first: usize,
        /// Second face.
        second: usize,
        /// Number of intersecting pairs.
        count: usize,
    },
    /// A node lies outside the boundary surface.
    #[error(
        "node {node} at {point:?} lies outside the boundary surface ({count} such nodes in all); \
         remove it or enlarge the surface"
    )]
    NodeOutside {
        /// First node outside.
        node: usize,
        /// Position of the node \[m\].
        point: [f64; 3],
        /// Number of nodes outside.
        count: usize,
    },
    /// Constrained faces could not be made faces of the Delaunay complex.
    #[error(
        "{count} constrained faces are not in the Delaunay complex after {inserted} inserted points \
         (limit {limit}), first ones {faces:?}; refine the surface there or allow more points"
    )]
    FacesNotRecovered {
        /// The first missing input faces (at most 16).
        faces: Vec<usize>,
        /// Number of missing input faces.
        count: usize,
        /// Number of points inserted so far.
        inserted: usize,
        /// Largest number of points allowed.
        limit: usize,
    },
    /// The constrained faces bound no tetrahedron.
    #[error(
        "the boundary surface of {faces} faces encloses no volume; check that it is not folded onto itself"
    )]
    EmptyDomain {
        /// Number of boundary faces.
        faces: usize,
    },
    /// A query point is outside the domain.
    #[error(
        "point {point:?} is outside the domain by more than {tolerance:e}; \
         move it inside or ask only for points of the closed domain"
    )]
    OutsideDomain {
        /// Coordinates of the point \[m\].
        point: [f64; 3],
        /// Absolute tolerance \[m\].
        tolerance: f64,
    },
    /// The Voronoi cells do not fill the domain.
    #[error(
        "the constrained Voronoi cells fill {filled:e} of the domain's volume {volume:e} \
         (relative defect above {tolerance:e}); refine the nodes on the constrained faces"
    )]
    CellsDoNotFill {
        /// Sum of the cell volumes \[m³\].
        filled: f64,
        /// Volume of the domain \[m³\].
        volume: f64,
        /// Relative tolerance.
        tolerance: f64,
    },
    /// The facets of a Voronoi cell do not close.
    #[error(
        "the facets of the constrained Voronoi cell of node {node} leave {defect:e} of their area open \
         (limit {tolerance:e}); move or refine the nodes there"
    )]
    CellOpen {
        /// The node.
        node: usize,
        /// `|sum A| / sum |A|`.
        defect: f64,
        /// Largest value accepted.
        tolerance: f64,
    },
    /// Linear displacements leave forces on nodes that should be in equilibrium.
    #[error(
        "model '{model}': {field} leaves {defect:e} of the forces around node {node} at {point:?} out of balance \
         (limit {tolerance:e}): the integration of this body cannot be trusted; move the nodes there by a fraction of their \
         spacing, or give coordinates with all digits"
    )]
    WrongForces {
        /// Name of the model.
        model: String,
        /// Field that was tested: a rigid motion or a constant strain.
        field: &'static str,
        /// Node with the largest relative defect.
        node: usize,
        /// Position of the node \[m\].
        point: [f64; 3],
        /// Unbalanced force, relative to the forces of the cells around the node before they cancel \[–\].
        defect: f64,
        /// Largest defect accepted \[–\].
        tolerance: f64,
    },
    /// Points have so many natural neighbours that cells and shape functions lose their meaning.
    #[error(
        "a point inside has {mean:.0} natural neighbours on average (limit {limit:.0}): {on_surface} of {nodes} nodes lie \
         on the surface; add nodes inside, about as dense as on the surface"
    )]
    TooManyNeighbours {
        /// Mean number of natural neighbours \[–\].
        mean: f64,
        /// Largest mean accepted \[–\].
        limit: f64,
        /// Number of nodes on constrained faces.
        on_surface: usize,
        /// Number of all nodes.
        nodes: usize,
    },
    /// A parameter is outside its valid range.
    #[error("{name} = {value}: {rule}")]
    Parameter {
        /// Name of the parameter.
        name: &'static str,
        /// Value given.
        value: String,
        /// Rule that the value must satisfy.
        rule: &'static str,
    },
    /// A selection contains nothing.
    #[error("no {what} of '{model}' satisfies the condition ({candidates} were looked at); check it")]
    EmptySelection {
        /// Name of the model.
        model: String,
        /// Kind of item that was selected from.
        what: &'static str,
        /// Number of items that the condition was applied to.
        candidates: usize,
    },
    /// An error of `arlequin-core`.
    #[error(transparent)]
    Core(#[from] arlequin_core::Error),
}

/// Creates an [`Error::Parameter`].
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
            Error::OutsideDomain { point, .. } => Self::OutsideDomain {
                point,
                role: "natural-neighbour".into(),
            },
            other => Self::of_model("cnem", other),
        }
    }
}
