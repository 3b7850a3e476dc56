"""Exceptions of arlequin. Each says the object, the value, the limit and the way out.

Everything derives from :class:`Error`: :class:`InputError` (a :class:`ValueError`) if what was given is to blame,
:class:`RunError` (a :class:`RuntimeError`) if the run failed. The others are named after the matter:

>>> import arlequin
>>> try:
...     arlequin.Elastic(young=-1.0, poisson=0.3, density=1.0)
... except arlequin.errors.InvalidParameter as e:
...     print(isinstance(e, ValueError))
True
"""

from __future__ import annotations

from typing import Optional


class Error(Exception):
    """Anything that arlequin raises."""

    key: Optional[str] = None
    """Key of the scene it speaks of, if any."""
    line: Optional[int] = None
    """Line of the scene's file, from 1, if it is known."""


class InputError(Error, ValueError):
    """What was given is to blame."""


class RunError(Error, RuntimeError):
    """The run failed, or the system did."""


class InternalError(Error):
    """A mistake in arlequin itself."""


class Warning(UserWarning):  # noqa: A001 - a warning of this package, as numpy and others name theirs
    """Something a user should know of a run."""


class Busy(RunError):
    """The object computes already, in another thread."""


class Model(InputError):
    """A model written outside of arlequin fails."""


# From here on by the names they have in Rust.

class Read(InputError):
    """A file cannot be read."""

class Write(RunError):
    """A file or folder cannot be written."""

class Syntax(InputError):
    """The text is not TOML, or not a scene."""

class Set(InputError):
    """A change that does not fit the scene."""

class Value(InputError):
    """A value that makes no sense."""

class Key(InputError):
    """A key that is needed and not there, or there and not wanted."""

class UnknownName(InputError):
    """A name that nothing bears."""

class Exists(InputError):
    """Results would be overwritten."""

class Unfinished(InputError):
    """A run was killed here and can go on."""

class Checkpoint(InputError):
    """A checkpoint cannot be used."""

class Interrupted(RunError):
    """The user ended work that takes long; Python raises :class:`KeyboardInterrupt` instead."""

class NotFinite(RunError):
    """A result is not a finite number."""

class System(RunError):
    """Anything of the system: threads, signal handler."""

class Observer(RunError):
    """What watches a run, or shows its results, failed at its own work."""

class NotSettled(RunError):
    """No equilibrium was reached."""

class OutsideDomain(InputError):
    """A point at which a field was asked for lies outside of it."""

class NoGradient(InputError):
    """A field has no gradient, but the junction needs one."""

class InvalidParameter(InputError):
    """A parameter has a value that makes no sense."""

class InvalidOption(InputError):
    """The same for an option of an interface."""

class NotPositiveDefinite(InputError):
    """A matrix that should be positive definite is not."""

class SingularSystem(InputError):
    """A linear system has no accurate solution."""

class EmptyOverlap(InputError):
    """The mediator and a model share no volume."""

class OverhangingMediator(InputError):
    """The mediator sticks out of a model."""

class PartitionOfUnity(InputError):
    """Weights do not sum to one."""

class PartitionMeasure(InputError):
    """Weights do not sum to one over a part of the overlap that is too large."""

class UnequalShapes(InputError):
    """One model fills more of the overlap than the other."""

class UnevenFilling(InputError):
    """A packing fills a part of the overlap more or less than the other model."""

class WeightMean(InputError):
    """The mean of a weight over a cell is not that of its values."""

class UnweightedEnergy(InputError):
    """The internal energy of a model does not follow its weight."""

class PartitionMass(InputError):
    """The weighted masses of all models are not the mass of the body."""

class UncoveredOverlap(InputError):
    """The mediator leaves a part of the overlap untied."""

class InitialJump(InputError):
    """The initial displacements of two models differ."""

class CoveredTwice(InputError):
    """The cells of a field cover the mediator more than once."""

class MomentumLeak(InputError):
    """The two sides sample the mediator differently, so that action and reaction differ."""

class SingularInterface(InputError):
    """The multiplier operator cannot be factored even after null modes are dropped."""

class EigenvaluesBeyond(RunError):
    """A Chebyshev iteration for multipliers does not damp what it should."""

class OpposedMotions(InputError):
    """Two models that are tied are moved in different ways at one place."""

class ZeroMass(InputError):
    """A node has no weighted mass."""

class UnstableStep(InputError):
    """The time step is not stable."""

class Diverged(RunError):
    """The run diverged."""

class EnergyGrowth(RunError):
    """Energy appears from nowhere."""

class EnergyLoss(RunError):
    """Energy vanishes."""

class ImpulseMissed(RunError):
    """A solver does not take the impulses that it is given."""

class MultipliersUnsolved(RunError):
    """The iteration for the multipliers does not reach its tolerance, and the models are hardly coupled."""

class NotRestored(InputError):
    """A solver is not the one of the checkpoint, or does not go back to what it saved."""

class Unsupported(InputError):
    """A model cannot do what is asked."""

class SizeMismatch(InputError):
    """Sizes of two objects that must agree do not."""

class Parameter(InputError):
    """A parameter has a value that makes no sense."""

class EmptyMesh(InputError):
    """Nothing to compute on."""

class Connectivity(InputError):
    """The connectivity cannot be cut into elements."""

class NodeNotFinite(InputError):
    """A coordinate is NaN or infinite."""

class NodeIndex(InputError):
    """An element refers to a node that does not exist."""

class UnreferencedNode(InputError):
    """No element uses a node."""

class CoincidentNodes(InputError):
    """Two nodes lie on top of each other."""

class SeparatePieces(InputError):
    """Pieces of a mesh touch and share no node."""

class RepeatedElement(InputError):
    """Two elements have the same nodes."""

class InvertedElement(InputError):
    """An element is turned inside out."""

class FlatElement(InputError):
    """An element has no volume."""

class BarDirection(InputError):
    """A bar of the axial model is not parallel to x."""

class UnknownGroup(InputError):
    """No group has the name."""

class NotASurface(InputError):
    """A group of nodes is asked for its surface."""

class EmptyGroup(InputError):
    """A selection found nothing."""

class Kind(InputError):
    """The operation is not made for this element kind."""

class File(InputError):
    """A file cannot be read."""

class Gmsh(InputError):
    """A Gmsh file is not understood."""

class CoincidentParticles(InputError):
    """Two particles sit on the same point: the bond between them has no direction."""

class BadRadius(InputError):
    """A particle without size has neither mass nor rotational inertia."""

class ZeroLengthBond(InputError):
    """A bond whose two ends coincide, or that joins a particle with itself."""

class IsolatedParticle(InputError):
    """A particle no bond holds: it would fly away at the first push."""

class NoSuchParticle(InputError):
    """A bond names a particle that does not exist."""

class LengthMismatch(InputError):
    """Two arrays that must run in parallel do not."""

class StartsInside(InputError):
    """Particles that start inside an obstacle or inside those of another body."""

class OutOfRange(InputError):
    """A parameter outside its range."""

class RadiusRatio(InputError):
    """The radii span a range the neighbour search and the contact law are not made for."""

class ContainerTooSmall(InputError):
    """Even one particle of the wanted size does not fit."""

class TooFewAcross(InputError):
    """Spheres nearly as wide as the body: no packing of them has bonds in all directions."""

class OutsideContainer(InputError):
    """A particle lies outside the container it should fill."""

class PeriodTooShort(InputError):
    """A periodic box in which a sphere would meet its own image."""

class Periodic(InputError):
    """A periodic packing where a body with a surface is needed."""

class Graded(InputError):
    """Something that particles of several materials cannot have."""

class NotPeriodic(InputError):
    """A packing with walls where a periodic one is needed."""

class OpenSurface(InputError):
    """A triangle surface that does not enclose a volume."""

class NoVolume(InputError):
    """A closed surface with (almost) nothing inside, or turned inside out."""

class NotJammed(InputError):
    """The packing did not jam at the wanted overlap."""

class TooFewPairs(InputError):
    """There are not as many neighbouring pairs as bonds wanted."""

class LooseSpheres(InputError):
    """So many spheres hang on no part of the body that leaving them out would change its density."""

class SeveralParts(InputError):
    """A packing that falls into several parts where one is needed."""

class InBody(InputError):
    """One of several bodies within a surface cannot be filled."""

class EmptyBody(InputError):
    """A body within a surface without a single sphere: its mass would be nowhere."""

class CrossingBodies(InputError):
    """Two bodies within one surface share space."""

class NotBroken(InputError):
    """A bar that stretches without breaking apart."""

class NoConvergence(InputError):
    """An iterative solver stopped short."""

class AxialWave(InputError):
    """A bar whose middle is stiffer or softer than the whole of it."""

class PoissonOutOfReach(InputError):
    """No beams of sensible thickness give the wanted Poisson's ratio."""

class BadSelection(InputError):
    """Selected particles cannot carry a load."""

class OneSidedSurface(InputError):
    """A closed surface without an inside, such as a Klein bottle."""

class Overlapping(InputError):
    """Two spheres of an imported packing of which one holds the centre of the other."""

class BadFile(InputError):
    """The bytes of a file are not what its format asks for."""

class NotAtRest(InputError):
    """A frame of a run whose spheres have moved, or whose bonds are broken."""

class ForeignRecord(InputError):
    """What a run remembered of another body."""

class MissingArray(InputError):
    """A file without the values needed."""

class Parse(InputError):
    """A text file that does not read."""

class Io(InputError):
    """The file system refused."""

class NonFinite(InputError):
    """A coordinate is NaN or infinite."""

class TooFewNodes(InputError):
    """Fewer than four distinct nodes."""

class AllCollinear(InputError):
    """All nodes lie on one straight line, exactly or up to the round-off of their coordinates."""

class AllCoplanar(InputError):
    """All nodes lie in one plane, exactly or up to the round-off of their coordinates."""

class DuplicateNodes(InputError):
    """Two nodes have the same coordinates."""

class NodesTooClose(InputError):
    """Two nodes are closer to each other than the round-off of coordinates of this size."""

class TooManyNodes(InputError):
    """More nodes or tetrahedra than 32-bit indices can name."""

class UnknownNode(InputError):
    """A face or element names a node that does not exist."""

class FlatFace(InputError):
    """A face has no area."""

class RepeatedFace(InputError):
    """The same three nodes are given as a face twice."""

class SelfIntersection(InputError):
    """Two constrained faces cross each other."""

class NodeOutside(InputError):
    """A node lies outside the boundary surface."""

class FacesNotRecovered(InputError):
    """Constrained faces could not be made faces of the Delaunay complex."""

class EmptyDomain(InputError):
    """The constrained faces bound no tetrahedron."""

class CellsDoNotFill(InputError):
    """The Voronoi cells do not fill the domain."""

class CellOpen(InputError):
    """The facets of a Voronoi cell do not close."""

class WrongForces(InputError):
    """A linear displacement field leaves forces where it has none."""

class TooManyNeighbours(InputError):
    """Points have so many natural neighbours that the method makes no sense."""

class EmptySelection(InputError):
    """A selection found nothing."""


class Address(InputError):
    """An address that is none, or none that a link may have."""

class Command(InputError):
    """A command that does not run, or ended before its time."""

class Silent(RunError):
    """Nobody came, or no answer."""

class Closed(RunError):
    """The other side is gone."""

class Stranger(RunError):
    """Not this protocol at all."""

class Version(RunError):
    """Another version of it."""

class Unexpected(RunError):
    """A message that is not due."""

class Length(RunError):
    """A message of another length than it must have."""

class Content(RunError):
    """A message whose content makes no sense."""

class Failed(RunError):
    """The other side says that it failed."""

class Mass(RunError):
    """It changes velocities by something else than impulse over the inertia that it told."""

class Heavier(RunError):
    """Its inertia under weights is more than without."""

class Broken(RunError):
    """A link that was used again after an error."""


class Agreed(RunError):
    """An error of this rank that all ranks know of."""


class Elsewhere(RunError):
    """Another rank of the run has an error, and says it."""


class Rank(InputError):
    """What went wrong between ranks."""


class InParts(InputError):
    """Something that needs all of a body."""


def _make(kind: str, message: str, key: Optional[str], line: Optional[int]) -> Error:
    """The exception of this name; of one that is not listed here, one that shows it."""
    found = globals().get(kind)
    known = isinstance(found, type) and issubclass(found, Error)
    made = found(message) if known and found is not None else RunError(f"{kind}: {message}")
    assert isinstance(made, Error)
    made.key, made.line = key, line
    return made
