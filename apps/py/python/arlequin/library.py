"""Parts of the library objects that are written in Python."""

from __future__ import annotations

import html
import math
from typing import Any, Optional

from . import _native, errors
from ._native import Junction, Weights
from .results import Table

__all__ = ["Coupled", "H1Gradient", "H1Seminorm", "H1Strain", "L2", "stiffness"]


def L2() -> Junction:  # noqa: N802 - the name of the literature
    """Junction L2: makes velocities agree. It has no length parameter."""
    return Junction("l2")


def H1Strain(length: float) -> Junction:  # noqa: N802
    """Junction H1: makes velocities agree, and strain rates weighted by ``length`` [m] squared."""
    return Junction("h1-strain", length)


def H1Gradient(length: float) -> Junction:  # noqa: N802
    """Junction H1: makes velocities agree, and velocity gradients weighted by ``length`` [m] squared."""
    return Junction("h1-gradient", length)


def H1Seminorm(length: float) -> Junction:  # noqa: N802
    """Junction H1 seminorm: makes velocity gradients agree, and velocities at one point; ``length`` [m]."""
    return Junction("h1-seminorm", length)


class Coupled(_native.Coupled):
    __doc__ = _native.Coupled.__doc__

    @property
    def energies(self) -> Table:
        """Energies over time, one row for each time the energy balance was computed; ``H`` is the invariant."""
        return Table(self._energies(), "energies")

    def run_until(self, time: float, observer: Any = None, every: int = 1) -> int:
        """Makes steps until ``time`` [s] is reached and returns their number."""
        if not math.isfinite(time):
            raise errors.InputError(f"time = {time}: must be finite [s]", code="InvalidParameter")
        left = max(0, -int(-(time - self.time) * (1 - 1e-12) // self.dt))
        return self.run(left, observer, every)

    def __repr__(self) -> str:
        try:
            state = f"step {self.steps}, {self.time:g} s"
        except errors.Busy:
            state = "computing in another thread"
        return f"<Coupled {', '.join(self.names)}: {state}>"

    def _repr_html_(self) -> str:
        try:
            head = html.escape(f"{self!r}, drift {self.drift:.1e}")
        except errors.Busy:
            head = html.escape(repr(self))
        return f"<p>{head}</p>" + self.energies._repr_html_()


def stiffness(model: Any, weights: Optional[Weights] = None) -> Any:
    """Returns the weighted stiffness matrix of a linear model of the library, as a scipy matrix [N/m]."""
    from scipy.sparse import csr_matrix

    data, columns, begin = model._stiffness(weights)
    return csr_matrix((data, columns, begin), shape=(len(begin) - 1, len(begin) - 1))
