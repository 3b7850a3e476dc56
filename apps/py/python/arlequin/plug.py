"""Base classes of models and solvers written in Python.

A model computes forces, and the run makes its time steps; a solver makes its own time steps. Arrays over unknowns are
flat, ``x0 y0 z0 x1 …`` (one number per node for bars along x), then rotations; returned arrays may have any shape of that
size.

Weights are passed as arrays: means over the elements of ``mesh``, over ``bonds`` if there are any, otherwise values at
nodes. Energy and mass belong to elements and bonds: a model that multiplies each element matrix by its element's weight
has exactly its share of the energy.
"""

from __future__ import annotations

from typing import Any, Optional, Union

import numpy as np

from . import errors
from ._native import Field, Mesh, Shares

__all__ = ["LinearModel", "Model", "Participant"]


class _Described:
    name: str = "python"
    """Name for messages and reports."""
    kind: str = "python"
    """Kind of model, for reports."""
    mesh: Optional[Mesh] = None
    """Nodes and shape functions; weights belong to its elements."""
    field: Union[Mesh, Field, None] = None
    """Shape functions that replace those of ``mesh``, such as an :class:`arlequin.Field` of particles."""
    bonds: Any = None
    """Pairs of nodes, (n, 2); if given, weights belong to these bonds and not to elements."""
    components: Optional[int] = None
    """Displacements per node; by default 3, or 1 for bars."""
    rotations: int = 0
    """Rotations per node: 3 for particles with rotations."""


class Model(_Described):
    """A model with forces of any law. It needs ``mesh`` or ``field``, and the four methods below.

    Optional methods:

    * ``advance(q)`` returns the forces at the displacements of a completed step (once per step, instead of
      ``internal_forces``);
    * ``critical_step(inverse_inertia)`` [s], needed by laws that are not linear about rest;
    * ``save()`` and ``restore(numbers)`` for the model's history.

    ``arms = "present"`` says that the moments of its forces vanish about present positions, as those of finite strain do;
    by default they vanish about reference positions.

    >>> import numpy as np
    >>> class Cubic(Model):
    ...     name = "cubic springs"
    ...     def __init__(self, x, k, m):
    ...         self.mesh, self.k, self.m, self.w = Mesh.line(x), k, m, np.ones(len(x) - 1)
    ...     def inertia(self, weight):
    ...         half = 0.5 * self.m * weight
    ...         return np.append(half, 0) + np.append(0, half)
    ...     def set_internal_weight(self, weight):
    ...         self.w = weight.copy()
    ...     def internal_forces(self, q):
    ...         tension = self.w * self.k * (np.diff(q) + np.diff(q) ** 3)
    ...         return np.append(tension, 0) - np.append(0, tension)
    ...     def internal_energy(self, q):
    ...         d = np.diff(q)
    ...         return float(np.sum(self.w * self.k * (d**2 / 2 + d**4 / 4)))
    >>> from arlequin import conformance
    >>> conformance.forces_derive_from_energy(Cubic(np.arange(11.0), 2.0, 1.0), amplitude=0.1) < 1e-7
    True
    """

    def inertia(self, weight: np.ndarray) -> np.ndarray:
        """Returns the weighted lumped inertia, per unknown or per node [kg, kg m2]."""
        raise NotImplementedError(f"{type(self).__name__}.inertia(weight) is missing")

    def set_internal_weight(self, weight: np.ndarray) -> None:
        """Stores the weight of the internal energy."""
        raise NotImplementedError(f"{type(self).__name__}.set_internal_weight(weight) is missing")

    def internal_forces(self, q: np.ndarray) -> np.ndarray:
        """Returns the weighted forces of the material on the nodes at displacements ``q`` [m] [N, N m]."""
        raise NotImplementedError(f"{type(self).__name__}.internal_forces(q) is missing")

    def internal_energy(self, q: np.ndarray) -> float:
        """Returns the energy whose negative gradient the forces are [J]."""
        raise NotImplementedError(f"{type(self).__name__}.internal_energy(q) is missing")


class LinearModel(_Described):
    """A model with forces ``-K q``. The matrix is requested once, so that steps take no time in Python.

    Override :meth:`stiffness` and :meth:`inertia`, which receive weights. If the weights are uniform, fixed arrays are enough:

    :param name: name of the model.
    :param mesh: nodes and shape functions: a mesh or a field.
    :param stiffness: symmetric matrix of scipy or numpy [N/m].
    :param inertia: lumped mass per unknown or per node [kg].

    >>> import numpy as np, scipy.sparse as sp
    >>> class Bar(LinearModel):
    ...     def __init__(self, x, k, m):
    ...         self.name, self.mesh, self.k, self.m = "bar", Mesh.line(x), k, m
    ...         self.B = sp.diags_array([-1.0, 1.0], offsets=[0, 1], shape=(len(x) - 1, len(x)))
    ...     def stiffness(self, weight):
    ...         return self.B.T @ sp.diags_array(self.k * weight) @ self.B
    ...     def inertia(self, weight):
    ...         return abs(self.B).T @ (self.m / 2 * weight)
    >>> from arlequin import conformance
    >>> bar = Bar(np.linspace(0, 1, 11), 10.0, 0.1)
    >>> conformance.rigid_forces(bar) < 1e-14 and conformance.mass(bar, 1.0) < 1e-14
    True
    """

    def __init__(self, name: str, mesh: Union[Mesh, Field], stiffness: Any, inertia: Any) -> None:
        self.name = name
        if isinstance(mesh, Mesh):
            self.mesh = mesh
        else:
            self.field = mesh
        self._stiffness, self._inertia = stiffness, np.asarray(inertia, float)

    def stiffness(self, weight: np.ndarray) -> Any:
        """Returns the weighted stiffness as a matrix of scipy or numpy [N/m]."""
        return self._stiffness * self._constant(weight)

    def inertia(self, weight: np.ndarray) -> np.ndarray:
        """Returns the weighted lumped inertia, per unknown or per node [kg]."""
        return self._inertia * self._constant(weight)

    def _constant(self, weight: np.ndarray) -> float:
        # The coupling gives weights of 1 - 1e-6 to a solver that cannot weight its energy; 1e-5 leaves room for these.
        if weight.size and np.ptp(weight) > 1e-5:
            raise errors.InputError(
                f"model '{self.name}' cannot share its energy by weights from {weight.min():g} to {weight.max():g}: it has "
                "one matrix; override stiffness(weight) and inertia(weight), or give a ramp with profile 'constant' and "
                "value=1e-6, or take Weights.with_weighting('nodal')",
                code="Unsupported",
            )
        return float(weight.mean()) if weight.size else 1.0


class Participant(_Described):
    """A whole solver that makes its own steps. It needs ``mesh`` or ``field``, and the five methods below.

    Optional methods:

    * ``accelerations()``, for a first step as smooth as all others;
    * ``critical_step()`` [s];
    * ``invariant()``, the energy that its scheme conserves except for impulses [J];
    * ``save()`` and ``restore(numbers)``.
    """

    def weigh(self, weights: Shares) -> np.ndarray:
        """Stores the weights and returns the weighted lumped inertia, per unknown or per node [kg]. Called before any
        step, first with weights of one. A solver that cannot weight its energy is given weights of nearly one and returns
        its unweighted inertia."""
        raise NotImplementedError(f"{type(self).__name__}.weigh(weights) is missing")

    def advance(self, time: float, step: float) -> None:
        """Advances from ``time`` by ``step`` [s], in any number of own steps."""
        raise NotImplementedError(f"{type(self).__name__}.advance(time, step) is missing")

    def velocities(self) -> np.ndarray:
        """Returns the present velocities of all unknowns [m/s]."""
        raise NotImplementedError(f"{type(self).__name__}.velocities() is missing")

    def displacements(self) -> np.ndarray:
        """Returns the present displacements of all unknowns [m]."""
        raise NotImplementedError(f"{type(self).__name__}.displacements() is missing")

    def kick(self, impulse: np.ndarray) -> None:
        """Changes the velocity of every unknown by ``impulse`` [kg m/s] over inertia, without changing displacements."""
        raise NotImplementedError(f"{type(self).__name__}.kick(impulse) is missing")


def _rows(matrix: Any, name: str) -> tuple[int, list[int], list[int], np.ndarray]:
    """Returns size, row starts, columns and values of a sparse or full matrix."""
    if hasattr(matrix, "tocsr"):
        rows = matrix.tocsr().astype(float)
        rows.sum_duplicates()
        rows.sort_indices()
        shape, begin, columns, values = rows.shape, rows.indptr, rows.indices, rows.data
    else:
        full = np.atleast_2d(np.asarray(matrix, float))
        shape = full.shape
        used = [np.flatnonzero(row) for row in full] if full.ndim == 2 else []
        begin = np.cumsum([0, *(len(u) for u in used)])
        columns = np.concatenate(used) if used else np.zeros(0, int)
        values = full[full != 0.0]
    if len(shape) != 2 or shape[0] != shape[1]:
        raise errors.InputError(f"stiffness of '{name}' has the shape {shape}; give a square matrix", code="SizeMismatch")
    return shape[0], begin.tolist(), columns.tolist(), np.asarray(values, float)
