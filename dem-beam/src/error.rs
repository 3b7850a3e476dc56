//! Errors of this crate. Each names the object, its value, the limit and the remedy.

/// An error of this crate.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Two particles sit on the same point: the bond between them has no direction.
    #[error(
        "particles {first} and {second} are {distance:e} m apart, below {limit:e} m: \
         merge them or move one"
    )]
    CoincidentParticles {
        /// Smaller particle number.
        first: usize,
        /// Larger particle number.
        second: usize,
        /// Distance of the centres \[m\].
        distance: f64,
        /// Smallest accepted distance \[m\].
        limit: f64,
    },
    /// A particle without size has neither mass nor rotational inertia.
    #[error("particle {particle} has radius {radius:e} m: give every particle a finite radius > 0")]
    BadRadius {
        /// Particle number.
        particle: usize,
        /// The radius found \[m\].
        radius: f64,
    },
    /// A fracture energy was given for a criterion that compares stresses.
    #[error(
        "criterion '{criterion}' compares stresses, and takes no fracture energy: choose 'energy' or \
         'tensile-energy', or give a strength [Pa]"
    )]
    StressCriterion {
        /// Name of the criterion.
        criterion: &'static str,
    },
    /// Beams that would hold more energy at their strength than they may take until they fail.
    #[error(
        "gc = {gc:e} J/m2 and strength = {strength:e} Pa exclude each other with spheres of mean diameter {diameter:.3e} m: beams \
         at that stress hold more energy than a crack takes, and snap back; take spheres below {largest:.3e} m, or a lower strength"
    )]
    SnapBack {
        /// Fracture energy of the body \[J/m²\].
        gc: f64,
        /// Axial stress of the beams at their peak \[Pa\].
        strength: f64,
        /// Mean diameter of the spheres \[m\].
        diameter: f64,
        /// Diameter at which beams break at their peak \[m\].
        largest: f64,
    },
    /// A coordinate, weight or load is NaN or infinite.
    #[error("{what} of {object} {index} is {value}: it must be finite")]
    NotFinite {
        /// Name of the quantity.
        what: &'static str,
        /// Kind of object, "particle" or "bond".
        object: &'static str,
        /// Number of the object.
        index: usize,
        /// The value found.
        value: f64,
    },
    /// A bond whose ends coincide, or that joins a particle with itself.
    #[error(
        "bond {bond} between particles {first} and {second} has length {length:e} m, below \
         {limit:e} m: remove the bond"
    )]
    ZeroLengthBond {
        /// Bond number.
        bond: usize,
        /// First particle.
        first: usize,
        /// Second particle.
        second: usize,
        /// Length found \[m\].
        length: f64,
        /// Smallest accepted length \[m\].
        limit: f64,
    },
    /// A particle without bonds: nothing would hold it.
    #[error(
        "particle {particle} has no bond ({isolated} such particles): raise the coordination \
         number, or keep the largest connected component only"
    )]
    IsolatedParticle {
        /// First particle without bonds.
        particle: usize,
        /// Number of particles without bonds.
        isolated: usize,
    },
    /// A bond names a particle that does not exist.
    #[error("bond {bond} names particle {particle}, but there are only {count} particles")]
    NoSuchParticle {
        /// Bond number.
        bond: usize,
        /// Particle number that the bond names.
        particle: usize,
        /// Number of particles.
        count: usize,
    },
    /// An array that does not have the expected length.
    #[error("{what} has {found} entries where {expected} are needed")]
    LengthMismatch {
        /// Name of the array.
        what: &'static str,
        /// Length of the array.
        found: usize,
        /// Expected length.
        expected: usize,
    },
    /// Particles that start inside an obstacle or inside particles of another body. Contact would hold them
    /// there or throw them out.
    #[error(
        "{count} particles start inside {object}: the deepest is {depth:.3e} m behind its surface at ({:.3e}, {:.3e}, {:.3e}) m, \
         above the limit of {limit:.3e} m, the smaller radius, beyond which a centre lies inside; move one of the two, or turn the \
         normal of a plane towards the particles",
        place[0], place[1], place[2]
    )]
    StartsInside {
        /// Name of the obstacle or body that they are inside of.
        object: String,
        /// Number of particles inside.
        count: usize,
        /// Centre of the deepest particle \[m\].
        place: [f64; 3],
        /// Depth of this particle behind the surface \[m\].
        depth: f64,
        /// Largest depth that counts as touching \[m\]: the radius, of two particles the smaller one.
        limit: f64,
    },
    /// A parameter outside its range.
    #[error("{name} = {value} is outside {range}")]
    OutOfRange {
        /// Name of the parameter.
        name: &'static str,
        /// Value of the parameter.
        value: f64,
        /// Description of the accepted range.
        range: &'static str,
    },
    /// The ratio of radii is too large for the neighbour search and the contact law.
    #[error(
        "largest radius {largest:e} m is {ratio:.1} times the smallest {smallest:e} m, above \
         {limit}: narrow the radius distribution"
    )]
    RadiusRatio {
        /// Smallest radius \[m\].
        smallest: f64,
        /// Largest radius \[m\].
        largest: f64,
        /// Their ratio.
        ratio: f64,
        /// Largest accepted ratio.
        limit: f64,
    },
    /// The container is narrower than one particle of the wanted size.
    #[error(
        "a packing of {count} particles needs a largest diameter of {diameter:e} m but the \
         container is only {width:e} m wide: not one fits across; ask for more particles or a wider container \
         (packings need three across), and check that lengths are in m"
    )]
    ContainerTooSmall {
        /// Number of particles wanted.
        count: usize,
        /// Largest diameter of these particles \[m\].
        diameter: f64,
        /// Smallest width of the container \[m\].
        width: f64,
    },
    /// Spheres nearly as wide as the body, which cannot have bonds in all directions.
    #[error(
        "the body is {width:.3e} m wide at its narrowest, the {count} spheres in it have a mean diameter of {diameter:.3e} m: \
         only {across:.1} fit across; packings need three, and ten or more for the elasticity of the bulk: take smaller \
         spheres or a wider body, and check that lengths are in m"
    )]
    TooFewAcross {
        /// Number of spheres.
        count: usize,
        /// Mean diameter of the spheres \[m\].
        diameter: f64,
        /// Narrowest width of the body \[m\].
        width: f64,
        /// Width of the body over the mean diameter.
        across: f64,
    },
    /// A particle lies outside the container it should fill.
    #[error(
        "particle {particle} sticks out of the container by {excess:e} m, above {limit:e} m: \
         one of the two is not in m, or the packing is larger than its container"
    )]
    OutsideContainer {
        /// Particle number.
        particle: usize,
        /// Depth of the sphere behind the wall \[m\].
        excess: f64,
        /// Largest accepted depth \[m\].
        limit: f64,
    },
    /// A periodic box so short that a sphere could meet its own image.
    #[error(
        "the periodic box has an edge of {shortest:e} m, below {limit:e} m (twelve largest radii): ask for more \
         particles"
    )]
    PeriodTooShort {
        /// Shortest edge \[m\].
        shortest: f64,
        /// Shortest accepted edge \[m\].
        limit: f64,
    },
    /// A periodic packing where a body with a surface is needed.
    #[error(
        "{what} cannot be made of a periodic packing, whose bonds join images: pack a container with walls"
    )]
    Periodic {
        /// Object that was wanted.
        what: &'static str,
    },
    /// A request that needs particles of a single material.
    #[error(
        "{what} cannot be had by particles of several materials: give the model one material, or a model to each"
    )]
    Graded {
        /// Request that was refused.
        what: &'static str,
    },
    /// A request that needs the whole body, made on a rank's part of it.
    #[error(
        "{what} needs the whole body, and this rank holds a part of it: do it before the body is shared out, or on one rank"
    )]
    InParts {
        /// Request that was refused.
        what: &'static str,
    },
    /// A packing with walls where a periodic one is needed.
    #[error("bulk elasticity needs a periodic packing: make it in `Container::periodic`")]
    NotPeriodic,
    /// A triangle surface that is not closed, or whose triangles are not oriented alike.
    #[error(
        "the surface is not closed: the edge from ({:.3e}, {:.3e}, {:.3e}) to ({:.3e}, {:.3e}, {:.3e}) belongs to {count} triangles, not \
         to two; repair the surface there",
        ends[0][0], ends[0][1], ends[0][2], ends[1][0], ends[1][1], ends[1][2]
    )]
    OpenSurface {
        /// Vertices of the edge \[m\].
        ends: [[f64; 3]; 2],
        /// Number of triangles at the edge; two are expected, one in each direction.
        count: usize,
    },
    /// A closed surface that encloses (almost) no volume, or is turned inside out.
    #[error("the surface encloses {volume:e} m3: orient its triangles outwards")]
    NoVolume {
        /// Signed volume \[m³\].
        volume: f64,
    },
    /// The packing did not reach the wanted overlap.
    #[error(
        "packing not at the wanted overlap after {steps} relaxation steps: mean overlap \
         {overlap:e} of the diameter, wanted {wanted:e}; raise `max_steps` or the overlap"
    )]
    NotJammed {
        /// Relaxation steps done.
        steps: usize,
        /// Mean overlap reached (fraction of the mean diameter).
        overlap: f64,
        /// Mean overlap wanted.
        wanted: f64,
    },
    /// Fewer neighbouring pairs than wanted bonds.
    #[error(
        "coordination number {wanted} asks for {bonds} bonds, only {pairs} pairs are within \
         {reach} of touching: lower the coordination number"
    )]
    TooFewPairs {
        /// Coordination number wanted.
        wanted: f64,
        /// Number of bonds wanted.
        bonds: usize,
        /// Number of pairs found.
        pairs: usize,
        /// Largest relative gap that was searched.
        reach: f64,
    },
    /// Too many spheres without a bond to a connected part: leaving them out would change the density of the
    /// rest.
    #[error(
        "{loose} of {spheres} spheres ({:.2} % of the volume, above {:.2} %) have no bond to a part of at least four \
         spheres; leaving them out would put their mass on the rest ({}): raise the coordination number from \
         {coordination}, take more spheres or another seed, or keep them as loose grains with contact on",
        100.0 * share,
        100.0 * limit,
        sizes(parts)
    )]
    LooseSpheres {
        /// Number of spheres without a bond to a connected part.
        loose: usize,
        /// Number of all spheres.
        spheres: usize,
        /// Share of the loose spheres in the volume of all spheres.
        share: f64,
        /// Largest accepted share.
        limit: f64,
        /// Number of spheres of each connected part, largest first.
        parts: Vec<usize>,
        /// Coordination number wanted.
        coordination: f64,
    },
    /// A packing of several connected parts where a single one is needed.
    #[error(
        "{what} needs one connected part, the packing falls into {} and {loose} loose spheres: raise the coordination \
         number, leave loose spheres out, or test the parts one by one",
        sizes(parts)
    )]
    SeveralParts {
        /// Test that was refused.
        what: &'static str,
        /// Number of spheres of each connected part, largest first.
        parts: Vec<usize>,
        /// Number of spheres in no connected part.
        loose: usize,
    },
    /// One of several bodies within a surface cannot be filled.
    #[error("body {body} of the {bodies} within the surface ({volume:e} m3): {source}")]
    InBody {
        /// Number of the body, from 1.
        body: usize,
        /// Number of bodies within the surface.
        bodies: usize,
        /// Volume of the body \[m³\].
        volume: f64,
        /// Description of the problem.
        source: Box<Self>,
    },
    /// A body within a surface that contains no sphere; its mass would be missing.
    #[error("none of the spheres lies in it: give it spheres, or remove it from the surface")]
    EmptyBody,
    /// Two bodies within one surface that overlap.
    #[error(
        "bodies {first} and {second} within the surface cross: the point {point:?} m lies in both; join them into one \
         closed surface, or move one"
    )]
    CrossingBodies {
        /// Number of the first body, from 1.
        first: usize,
        /// Number of the second body, from 1.
        second: usize,
        /// A point inside of both bodies \[m\].
        point: [f64; 3],
    },
    /// A bar in a strength test that stretches without breaking.
    #[error(
        "the bar did not break up to a strain of {strain:e} (highest stress {stress:e} Pa): its broken bonds leave a path \
         that still carries; take a narrower scatter of strengths, or more spheres"
    )]
    NotBroken {
        /// Largest strain of the test.
        strain: f64,
        /// Highest stress \[Pa\].
        stress: f64,
    },
    /// An iterative solver that did not converge.
    #[error(
        "{what} stopped after {iterations} iterations at residual {residual:e}, wanted \
         {tolerance:e}: allow more iterations, or check that the supports hold every rigid motion"
    )]
    NoConvergence {
        /// Name of the solver.
        what: &'static str,
        /// Number of iterations done.
        iterations: usize,
        /// Relative residual reached.
        residual: f64,
        /// Relative residual wanted.
        tolerance: f64,
    },
    /// A bar whose gauge section is stiffer or softer than the whole bar.
    #[error(
        "the gauge section has E = {gauge:.4e} Pa, {:+.1} % from the {whole:.4e} Pa of the whole bar, above {:.0} %: \
         the packing has an axial density wave, or the bar is too short for its ends; take a bar of 36 mean diameters by \
         12, more seeds, or the onset protocol",
        100.0 * difference,
        100.0 * limit
    )]
    AxialWave {
        /// Young's modulus over the whole bar \[Pa\].
        whole: f64,
        /// Young's modulus of the gauge section \[Pa\].
        gauge: f64,
        /// Relative difference of the two moduli.
        difference: f64,
        /// Largest accepted difference.
        limit: f64,
    },
    /// No beams within the searched radius ratios give the wanted Poisson's ratio.
    #[error(
        "wanted Poisson's ratio {wanted}: beams of {} to {} mean radii give {thin:.4} to {thick:.4} on this packing; \
         change the target or the coordination number",
        ratios[0],
        ratios[1]
    )]
    PoissonOutOfReach {
        /// Poisson's ratio wanted.
        wanted: f64,
        /// Poisson's ratio with the thickest beams.
        thick: f64,
        /// Poisson's ratio with the thinnest beams.
        thin: f64,
        /// Radius ratios tried.
        ratios: [f64; 2],
    },
    /// A selection of particles that cannot carry a load.
    #[error("load on {count} particles: {reason}")]
    BadSelection {
        /// Number of selected particles.
        count: usize,
        /// Reason of the refusal, and the remedy.
        reason: &'static str,
    },
    /// An error of the coupling core.
    #[error(transparent)]
    Core(#[from] arlequin_core::Error),
    /// A closed surface without an inside, such as a Klein bottle.
    #[error(
        "the triangles at edge {first}-{second} cannot be turned alike: the surface has one side only, and no inside"
    )]
    OneSidedSurface {
        /// First vertex of the edge.
        first: usize,
        /// Second vertex of the edge.
        second: usize,
    },
    /// Two spheres of an imported packing, one of which contains the centre of the other.
    #[error(
        "particles {first} and {second} are {distance:e} m apart, but one has a radius of {limit:e} m: spheres of a \
         packing touch, they do not hold each other's centres; check the unit of the radii"
    )]
    Overlapping {
        /// Smaller particle number.
        first: usize,
        /// Larger particle number.
        second: usize,
        /// Distance of the centres \[m\].
        distance: f64,
        /// Smallest accepted distance: the larger radius \[m\].
        limit: f64,
    },
    /// A file that does not follow its format.
    #[error("this is no {format} file that can be read: {reason}")]
    BadFile {
        /// Format expected.
        format: &'static str,
        /// Description of the problem.
        reason: String,
    },
    /// A frame of a run whose spheres have moved or whose bonds are broken.
    #[error(
        "it is a later frame of a run: spheres have moved by up to {farthest:.3e} m, {broken} bonds are broken; spheres are read where \
         they were at rest and bonded anew, so that this state would be lost: take the run's first frame (its number is 00000000), go \
         on with the run by arlequin resume, or give the present centres and radii as .csv if a new body without stresses is meant"
    )]
    NotAtRest {
        /// Largest component of a displacement \[m\].
        farthest: f64,
        /// Number of broken bonds.
        broken: usize,
    },
    /// A saved state that belongs to another body.
    #[error("{what} is of another body; restore into the run that was saved")]
    ForeignRecord {
        /// Name of the record.
        what: &'static str,
    },
    /// A file without a needed array.
    #[error("no point array named {wanted}; the file has: {found}")]
    MissingArray {
        /// Names that were searched for.
        wanted: String,
        /// Names of the arrays in the file.
        found: String,
    },
    /// A line of a text file that cannot be read.
    #[error("line {line}: {reason}")]
    Parse {
        /// Line number, from 1.
        line: usize,
        /// Description of the problem.
        reason: String,
    },
    /// An error of the file system.
    #[error("{path}: {reason}")]
    Io {
        /// File or directory.
        path: String,
        /// Message of the operating system.
        reason: String,
    },
}

/// Result with the [`Error`] of this crate.
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    pub(crate) fn out_of_range(name: &'static str, value: f64, range: &'static str) -> Self {
        Self::OutOfRange { name, value, range }
    }

    /// Returns the error for a triangle with a vertex number that does not exist.
    pub(crate) fn no_vertex(vertex: u32) -> Self {
        Self::out_of_range(
            "vertex number of a triangle",
            f64::from(vertex),
            "numbers below the number of vertices",
        )
    }
}

/// Refuses NaN and infinities.
pub(crate) fn finite(what: &'static str, object: &'static str, index: usize, value: f64) -> Result<()> {
    if value.is_finite() {
        Ok(())
    } else {
        Err(Error::NotFinite {
            what,
            object,
            index,
            value,
        })
    }
}

/// Refuses a parameter that is not finite and positive.
pub(crate) fn positive(name: &'static str, value: f64) -> Result<()> {
    if value.is_finite() && value > 0.0 {
        Ok(())
    } else {
        Err(Error::out_of_range(name, value, "finite values > 0"))
    }
}

/// Returns the sizes of parts in words; the first few are listed.
fn sizes(parts: &[usize]) -> String {
    const NAMED: usize = 6;
    let named: Vec<String> = parts.iter().take(NAMED).map(ToString::to_string).collect();
    let more = if parts.len() > NAMED { ", ..." } else { "" };
    let word = if parts.len() == 1 { "part" } else { "parts" };
    format!("{} {word} of {}{more} spheres", parts.len(), named.join(", "))
}
