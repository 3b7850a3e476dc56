"""Couples dissimilar mechanics models by the Arlequin (bridging-domain) method.

Three ways in:

* a scene file: :class:`Scene`, :func:`run`, :func:`sweep`;
* the objects of the library: models, weights, mediators, junctions, :class:`Coupled`;
* a model or a solver of your own: derive from :class:`Model`, :class:`LinearModel` or :class:`Participant`.

SI units everywhere; arrays of points have the shape (n, 3), or (n,) along x.
"""

from . import errors
from ._native import __version__, set_threads
from .errors import Error
from .results import Fields, Frame, Probe, Record, Run, Table
from .scene import Progress, Scene, Sweep, resume, run, sweep

__all__ = [
    "Error",
    "Fields",
    "Frame",
    "Probe",
    "Progress",
    "Record",
    "Run",
    "Scene",
    "Sweep",
    "Table",
    "__version__",
    "errors",
    "resume",
    "run",
    "set_threads",
    "sweep",
]
