"""Checks for those who write a model or a solver: each answers a defect, zero up to round-off for a sound one.

:func:`check` asks for all that concern an object and raises with what is wrong.
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
    """Kicks a solver, which should be in motion, and lets it make so many steps of ``step`` [s].

    The solver stands elsewhere afterwards: take a fresh one for a run. ``step`` should be that of the run.

    Defects: ``travelled``, what nodes move in a step beside velocity times step (1 if they stand still or make two steps, 0.5
    after half a step; below 0.04 for a sound solver up to its critical step), ``gained``, the same of velocities and
    accelerations (0 without ``accelerations()``), ``kick`` of velocities after an impulse, ``moved`` by it at once, ``drift`` of the invariant over the steps,
    ``work`` of the impulse, ``resumed`` the same steps again from what was saved.
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
    """All defects of a model at displacements of ``amplitude`` [m], or of a solver in so many steps of ``step`` [s].

    A law of any sort passes; one that is not linear and turns with the body says so by ``arms = "present"`` and is turned by half a
    radian, others by a small angle. ``travelled`` and ``gained`` of a solver depend on its scheme and its step, and may be 0.05 and 0.4 where ``tolerance`` is
    less. What nobody sees from outside is whether forces are those of the material, and whether the stiffness of a solver
    has the weights that its inertia has.

    :raises arlequin.errors.InputError: if one is above ``tolerance``, with all of them and what they mean.
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
