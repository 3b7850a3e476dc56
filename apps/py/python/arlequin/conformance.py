"""Conformance checks for models and solvers. Each returns a defect: zero to round-off if the object is correct.

:func:`check` runs all checks that apply to an object and raises an error with the defects.
"""

from __future__ import annotations

from typing import Any, Optional

from . import errors
from ._native import forces_derive_from_energy, mass, rigid_forces, shapes, symmetric_forces
from ._native import participant as _participant
from .results import Record

__all__ = [
    "check",
    "forces_derive_from_energy",
    "mass",
    "participant",
    "rigid_forces",
    "shapes",
    "symmetric_forces",
]


def participant(solver: Any, step: float, steps: int = 100) -> Record:
    """Kicks a solver, which should be in motion, and lets it make ``steps`` steps of ``step`` [s].

    The state of the solver changes: use a new solver for a run. ``step`` should be the step of the run.

    Defects:

    * ``travelled``: motion of the nodes in a step against velocity times step (1 if they stand still or make two
      steps, 0.5 after half a step; below 0.04 for a correct solver up to its critical step);
    * ``gained``: change of velocities in a step against acceleration times step (0 without ``accelerations()``);
    * ``kick``: velocities after an impulse;
    * ``moved``: motion of the nodes by the impulse itself;
    * ``drift``: invariant over the steps;
    * ``work``: change of the invariant by the impulse;
    * ``resumed``: the same steps again from the saved state.
    """
    return Record(_participant(solver, step, steps))


def check(
    object: Any,  # noqa: A002 - as in all of Python
    *,
    amplitude: float = 1e-3,
    step: Optional[float] = None,
    steps: int = 100,
    tolerance: float = 1e-6,
) -> Record:
    """Returns all defects of a model at displacements of ``amplitude`` [m], or of a solver in ``steps`` steps of ``step`` [s].

    Any law can pass. A model is rotated by a small angle, or by half a radian if it says ``arms = "present"``, as a nonlinear
    law that rotates with the body should. ``travelled`` and ``gained`` of a solver depend on its scheme and its step:
    they may reach 0.05 and 0.4 even if ``tolerance`` is smaller. Two faults cannot be detected from outside: forces of
    another material, and a solver's stiffness with other weights than its inertia.

    :raises arlequin.errors.InputError: if a defect exceeds ``tolerance``; the message lists these defects with their meaning.
    """
    if hasattr(object, "kick"):
        if step is None:
            raise errors.InputError("a solver is checked in steps of a length: give step=… [s]", code="Key")
        found = participant(object, step, steps)
    else:
        found = Record(
            rigid_forces=rigid_forces(object, amplitude),
            forces_derive_from_energy=forces_derive_from_energy(object, amplitude),
            symmetric_forces=symmetric_forces(object, amplitude),
        )
    means = {
        "rigid_forces": "a rigid motion strains it (a law of finite strain says arms = \"present\")",
        "forces_derive_from_energy": "forces are not minus the slope of the energy",
        "symmetric_forces": "work depends on the way",
        "travelled": "nodes do not move by velocity times step: it makes no step, half of one, or two",
        "gained": "velocities do not change by acceleration times step: accelerations() tells something else, or nothing acts",
        "kick": "an impulse does not change velocities by impulse over inertia",
        "moved": "an impulse moves nodes at once",
        "drift": "its stepping does not keep what invariant() tells",
        "work": "invariant() does not change by the work of an impulse",
        "resumed": "it does not go on with the same numbers after restore",
    }
    rough = {"travelled": 0.05, "gained": 0.4}
    limits = {name: max(tolerance, rough.get(name, 0.0)) for name in found}
    wrong = [f"{name} = {value:.1e}: {means[name]}" for name, value in found.items() if not value <= limits[name]]
    if wrong:
        raise errors.InputError(f"'{getattr(object, 'name', object)}' is not fit to be coupled: " + "; ".join(wrong), code="Unsupported")
    return found
