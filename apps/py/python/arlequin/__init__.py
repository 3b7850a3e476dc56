"""Couples dissimilar mechanics models by the Arlequin (bridging-domain) method.

Three ways in:

* a scene file: :class:`Scene`, :func:`run`, :func:`sweep`;
* the objects of the library: models, weights, mediators, junctions, :class:`Coupled`;
* a model or a solver of your own: derive from :class:`Model`, :class:`LinearModel` or :class:`Participant`.

SI units everywhere; arrays of points have the shape (n, 3), or (n,) along x.

Two bars with coarse and fine elements, coupled over one unit of length:

>>> import numpy as np
>>> steel = Elastic(1.0, 0.0, 1.0)
>>> left = FemModel("left", Mesh.bar(-9.0, 1.0, 20), steel)
>>> right = FemModel("right", Mesh.bar(0.0, 10.0, 80), steel)

The weight of the left model falls from 1 to 0 between x = 0 and x = 1; the right model has the rest:

>>> coarse = Weights.same(Ramp(Slab(fine=1.0, coarse=0.0), "cubic"))
>>> fine = Weights.complement_of(coarse)
>>> tie = Interface("overlap", "left", "right", Mesh.bar(0.0, 1.0, 2), L2())
>>> moving = Subdomain.fine(right, fine).with_initial(np.zeros(81), np.ones(81))
>>> run = Coupled([Subdomain.coarse(left, coarse), moving], [tie], fraction=0.9)
>>> run.run(1000)
1000
>>> run.drift < 1e-11 and run.constraint_residual < 1e-11
True
"""

import os as _os
import warnings as _warnings

from . import conformance, errors
from ._native import (
    BodyForce,
    ChainModel,
    CnemModel,
    DemModel,
    Effect,
    Elastic,
    FemModel,
    Field,
    Interface,
    Junction,
    Load,
    LocalDamping,
    MassDamping,
    Mesh,
    Packing,
    Ramp,
    Region,
    Shell,
    Slab,
    StiffnessDamping,
    Subdomain,
    TimeFunction,
    Weights,
    __version__,
    _bound_threads,
    _forked,
    set_threads,
)
from .errors import Error
from .library import H1Gradient, H1Seminorm, H1Strain, L2, Coupled, stiffness
from .plug import LinearModel, Model, Participant
from .results import Fields, Frame, Probe, Record, Run, Table
from .scene import Progress, Scene, Sweep, resume, run, sweep

if (_told := _bound_threads()) is not None:
    _warnings.warn(_told, errors.Warning, stacklevel=2)

if hasattr(_os, "register_at_fork"):
    # A forked process, as multiprocessing starts it up to Python 3.13, lacks its parent's threads and needs new ones.
    _os.register_at_fork(after_in_child=_forked)

__all__ = [
    "BodyForce",
    "ChainModel",
    "CnemModel",
    "Coupled",
    "DemModel",
    "Effect",
    "Elastic",
    "Error",
    "FemModel",
    "Field",
    "Fields",
    "Frame",
    "H1Gradient",
    "H1Seminorm",
    "H1Strain",
    "Interface",
    "Junction",
    "L2",
    "LinearModel",
    "Load",
    "LocalDamping",
    "MassDamping",
    "Mesh",
    "Model",
    "Packing",
    "Participant",
    "Probe",
    "Progress",
    "Ramp",
    "Record",
    "Region",
    "Run",
    "Scene",
    "Shell",
    "Slab",
    "StiffnessDamping",
    "Subdomain",
    "Sweep",
    "Table",
    "TimeFunction",
    "Weights",
    "__version__",
    "conformance",
    "errors",
    "resume",
    "run",
    "set_threads",
    "stiffness",
    "sweep",
]
