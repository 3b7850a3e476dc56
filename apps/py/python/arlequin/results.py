"""Results of a run: values over time as numpy arrays, everything else as dictionaries."""

from __future__ import annotations

import html
import json
import re
from pathlib import Path
from typing import Any, Iterator, Mapping, Optional, Sequence

import numpy as np

from . import _native, errors

__all__ = ["Fields", "Frame", "Probe", "Record", "Run", "Table"]


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, (list, dict)) and len(json.dumps(value, default=str)) > 200:
        return f"{len(value)} entries"
    plain = json.dumps(value, ensure_ascii=False, default=str) if isinstance(value, (list, dict)) else str(value)
    return html.escape(plain)


def _html_table(head: Sequence[str], rows: Sequence[Sequence[Any]], caption: str = "") -> str:
    title = f"<caption>{html.escape(caption)}</caption>" if caption else ""
    top = "".join(f"<th>{html.escape(h)}</th>" for h in head)
    body = "".join("<tr>" + "".join(f"<td>{_cell(c)}</td>" for c in row) + "</tr>" for row in rows)
    return f"<table>{title}<thead><tr>{top}</tr></thead><tbody>{body}</tbody></table>"


class Record(dict):  # type: ignore[type-arg]
    """A dictionary whose entries are attributes as well: ``record["dt"]`` is ``record.dt``."""

    def __getattr__(self, name: str) -> Any:
        try:
            return self[name]
        except KeyError:
            raise AttributeError(f"there is no {name!r}; there are: {', '.join(self)}") from None

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self]

    def _repr_html_(self) -> str:
        return _html_table(["", ""], list(self.items()))


def record(text: str) -> Record:
    """Returns a JSON text as nested records."""
    out = json.loads(text, object_hook=Record)
    assert isinstance(out, Record)
    return out


def _split(label: str) -> tuple[str, str]:
    """Splits ``name [unit]`` into name and unit."""
    found = re.fullmatch(r"(.*?) \[(.*)\]", label)
    return (found[1], found[2]) if found else (label, "")


class Table(Mapping[str, np.ndarray]):
    """Columns over time; ``t`` is the time [s]. A column is an item, and an attribute by its name in snake case:
    ``energy["kinetic [J]"]``, ``energy["kinetic"]`` and ``energy.kinetic`` are the same. ``H`` of the energy table is the
    invariant, which a correct run conserves.
    """

    def __init__(self, columns: Mapping[str, np.ndarray], title: str = "") -> None:
        self._columns = dict(columns)
        self._title = title
        short = {}
        for name in self._columns:
            plain = _split(name)[0]
            short[plain] = short[re.sub(r"\W+", "_", plain)] = name
        short.setdefault("t", "time [s]")
        if "invariant" in short:
            short["H"] = short["invariant"]
        self._short = short

    def __getitem__(self, name: str) -> np.ndarray:
        try:
            return self._columns[self._short.get(name, name)]
        except KeyError:
            raise KeyError(f"no column {name!r}; there are: {', '.join(self._columns)}") from None

    def __getattr__(self, name: str) -> np.ndarray:
        if name.startswith("_") or name not in self.__dict__.get("_short", ()):
            raise AttributeError(f"no column {name!r}; there are: {', '.join(self.__dict__.get('_columns', ()))}")
        return self._columns[self._short[name]]

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __len__(self) -> int:
        return len(self._columns)

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *(n for n in self._short if n.isidentifier())]

    def __repr__(self) -> str:
        rows = len(next(iter(self._columns.values()), ()))
        return f"<{self._title or 'Table'}: {rows} rows of {', '.join(self._columns)}>"

    def _repr_html_(self) -> str:
        rows = len(next(iter(self._columns.values()), ()))
        shown = [*range(min(rows, 5)), *range(max(rows - 5, 5), rows)]
        values = [[float(c[k]) for c in self._columns.values()] for k in shown]
        return _html_table(list(self._columns), values, f"{self._title} ({rows} rows)")

    def plot(self, *names: str, ax: Any = None) -> Any:
        """Plots columns over time with matplotlib, all by default; returns the axes."""
        axes = ax if ax is not None else _pyplot().subplots()[1]
        for name in names or [n for n in self._columns if n != "time [s]"]:
            axes.plot(self.t, self[name], label=self._short.get(name, name))
        axes.set_xlabel("time [s]")
        axes.legend()
        return axes


_SYMBOLS = {
    "displacement": "u",
    "velocity": "v",
    "rotation": "theta",
    "force": "F",
    "moment": "M",
    "stress": "sigma",
    "strain": "epsilon",
    "von Mises stress": "sigma_v",
    "principal stress": "sigma",
}


class Probe:
    """A probe over time: ``t`` [s] and ``values``. The symbol of its quantity is another name of ``values``: ``u`` for a
    displacement, ``v`` for a velocity, ``F`` for a force.
    """

    def __init__(self, name: str, label: str, t: np.ndarray, values: np.ndarray, facts: Record) -> None:
        self.name = name
        """Name of the probe in the scene."""
        self.quantity, self.unit = _split(label)
        """Quantity that it reads, and its unit."""
        self.t, self.values = t, values
        self.facts = facts
        """Mean, extremes and frequencies, as in ``summary.json``."""

    @property
    def symbol(self) -> str:
        """Symbol of its quantity."""
        return _SYMBOLS.get(self.quantity, "values")

    def __getattr__(self, name: str) -> np.ndarray:
        # copy and pickle look up attributes before the object has any.
        if name.startswith("_") or "quantity" not in self.__dict__:
            raise AttributeError(name)
        if name == self.symbol:
            return self.values
        what = f"probe {self.name!r} has no {name!r}; it reads a {self.quantity}: ask for {self.symbol!r} or 'values'"
        raise AttributeError(what)

    def __array__(self, dtype: Any = None, copy: Optional[bool] = None) -> np.ndarray:
        return np.asarray(self.values, dtype)

    def __len__(self) -> int:
        return len(self.values)

    def __repr__(self) -> str:
        return f"<Probe {self.name!r}: {len(self)} values of {self.quantity} [{self.unit}]>"

    def plot(self, ax: Any = None) -> Any:
        """Plots the probe over time with matplotlib; returns the axes."""
        axes = ax if ax is not None else _pyplot().subplots()[1]
        axes.plot(self.t, self.values, label=self.name)
        axes.set_xlabel("time [s]")
        axes.set_ylabel(f"{self.quantity} [{self.unit}]")
        axes.legend()
        return axes


class Fields(Mapping[str, np.ndarray]):
    """Fields of one model at one time, by their names with or without unit. Fields of nodes have one row per node or
    particle, fields of cells one row per cell.
    """

    def __init__(self, points: Mapping[str, np.ndarray], cells: Mapping[str, np.ndarray]) -> None:
        self.points, self.cells = dict(points), dict(cells)
        """Fields of nodes and fields of cells, with units in their names."""
        self._all = {**self.points, **self.cells}
        self._short = {_split(n)[0]: n for n in self._all}

    def __getitem__(self, name: str) -> np.ndarray:
        try:
            return self._all[self._short.get(name, name)]
        except KeyError:
            raise KeyError(f"no field {name!r}; there are: {', '.join(self._all)} (output.fields of the scene)") from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._all)

    def __len__(self) -> int:
        return len(self._all)

    def __repr__(self) -> str:
        return f"<Fields: {', '.join(f'{n} {a.shape}' for n, a in self._all.items())}>"


class Frame(Mapping[str, Fields]):
    """Fields of all models at one ``time`` [s], by the names of the models."""

    def __init__(self, time: float, models: Mapping[str, Fields]) -> None:
        self.time = time
        self._models = dict(models)

    def __getitem__(self, name: str) -> Fields:
        if name not in self._models:
            raise KeyError(f"there is no model {name!r}; there are: {', '.join(self)}")
        return self._models[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._models)

    def __len__(self) -> int:
        return len(self._models)

    def __repr__(self) -> str:
        return f"<Frame at {self.time:g} s: {', '.join(self._models)}>"


class _Named(dict):  # type: ignore[type-arg]
    """A dictionary whose error for a missing key lists the keys."""

    def __init__(self, what: str, of: Mapping[str, Any]) -> None:
        super().__init__(of)
        self._what = what

    def __missing__(self, name: str) -> Any:
        raise KeyError(f"there is no {self._what} {name!r}; there are: {', '.join(self) or 'none'}")


def _pyplot() -> Any:
    try:
        import matplotlib.pyplot as plt
    except ImportError:
        raise errors.RunError("drawing needs matplotlib: pip install arlequin[plot]", code="System") from None
    return plt


class Run:
    """Results of a run.

    ``summary`` has the content of ``summary.json``; ``probes``, ``energy``, ``effects`` and ``curves`` are tables over time;
    :meth:`fields` returns the states of the frames.
    """

    def __init__(self, native: _native.Results) -> None:
        self._native = native
        self.summary: Record = record(native.summary())
        """Content of ``summary.json``."""
        columns = native.probes()
        t = columns.pop("time [s]")
        facts = self.summary["probes"]
        self.probes: dict[str, Probe] = _Named(
            "probe",
            {n: Probe(n, facts[n]["quantity"], t, c, facts[n]) for n, c in zip(facts, columns.values())},
        )
        """Probes by their names."""
        self.energy = Table(native.energy(), "energy")
        """Energies, works and momenta over time; ``H`` is the invariant, ``relative_drift`` its change."""
        self.effects = Table(native.effects(), "effects")
        """Values of the effects over time."""

    @property
    def folder(self) -> Optional[Path]:
        """Folder of the results, if they were written."""
        return None if self._native.folder is None else Path(self._native.folder)

    @property
    def curves(self) -> dict[str, Table]:
        """Tables of one probe over another, as the scene requests."""
        return _Named("curve", {n: Table(c, n) for n, c in self._native.curves().items()})

    @property
    def warnings(self) -> list[str]:
        """Warnings of the run."""
        return list(self.summary["warnings"])

    @property
    def fragments(self) -> np.ndarray:
        """Fragments of broken bodies, one row per fragment and frame; number 0 stands for all particles without a bond."""
        kinds = [("time", "f8"), ("model", "U64"), ("number", "i8"), ("particles", "i8"), ("mass", "f8")]
        dtype = np.dtype([*kinds, ("centre", "f8", 3), ("velocity", "f8", 3)])
        return np.array(self._native.fragments(), dtype)

    @property
    def times(self) -> np.ndarray:
        """Times of the frames [s]."""
        return self._native.times()

    @property
    def grids(self) -> dict[str, Record]:
        """Reference grids: ``points`` (n, 3) [m], ``cells`` (nodes of each cell), ``cell_type`` of VTK, ``radii`` [m]."""
        return _Named("model", {n: Record(g) for n, g in self._native.grids().items()})

    def fields(self, t: Optional[float] = None) -> Frame:
        """Returns the frame nearest to time ``t`` [s], by default the last one: displacements, velocities, stresses … of all models,
        ``run.fields(1e-4)["bar"]["displacement"]``.
        """
        times = self.times
        if len(times) == 0:
            raise errors.InputError("this run kept no frames; run the scene with frames=20, or look into its folder", code="Key")
        if t is not None and not np.isfinite(t):
            raise errors.InputError(f"t = {t}: must be finite [s]", code="Value")
        k = len(times) - 1 if t is None else int(np.argmin(np.abs(times - t)))
        models = self._native.fields(k)
        return Frame(float(times[k]), {n: Fields(m["points"], m["cells"]) for n, m in models.items()})

    def mesh(self, model: str, t: Optional[float] = None) -> Any:
        """Returns a model as a PyVista mesh in its reference positions, with the fields of the frame nearest to time ``t`` [s].
        ``mesh.warp_by_vector("displacement [m]")`` deforms it.
        """
        try:
            import pyvista
        except ImportError:
            raise errors.RunError("meshes need PyVista: pip install arlequin[mesh]", code="System") from None
        frame, grid = self.fields(t)[model], self.grids[model]
        cells = np.asarray(grid["cells"])
        count = np.full((len(cells), 1), cells.shape[1] if cells.ndim == 2 else 0)
        kinds = np.full(len(cells), grid["cell_type"], dtype=np.uint8)
        out = pyvista.UnstructuredGrid(np.hstack([count, cells]).ravel(), kinds, grid["points"])
        for name, values in frame.points.items():
            out.point_data[name] = values
        for name, values in frame.cells.items():
            out.cell_data[name] = values
        return out

    def plot(self) -> Any:
        """Plots all probes over time with matplotlib, one plot per quantity; returns the figure."""
        labels = sorted({f"{p.quantity} [{p.unit}]" for p in self.probes.values()})
        figure, all_axes = _pyplot().subplots(max(len(labels), 1), 1, squeeze=False, sharex=True)
        for label, axes in zip(labels, all_axes[:, 0]):
            for p in self.probes.values():
                if f"{p.quantity} [{p.unit}]" == label:
                    p.plot(axes)
        return figure

    def __repr__(self) -> str:
        s = self.summary
        models = ", ".join(f"{m['name']} ({m['unknowns']} unknowns)" for m in s["models"])
        return (
            f"<Run of {s['scene']!r}, {s['status']}: {s['steps']} steps to {s['time']:g} s; {models}; "
            f"drift {s['energy']['h_drift_max']:.1e}; probes {', '.join(self.probes) or 'none'}>"
        )

    def _repr_html_(self) -> str:
        s = self.summary
        models = [[m["name"], m["kind"], m["unknowns"], m["own_dt"]] for m in s["models"]]
        all_probes = self.probes.values()
        probes = [[p.name, p.quantity, p.unit, float(p.values[-1]), p.facts["min"], p.facts["max"]] for p in all_probes]
        title = html.escape(s["title"] or s["scene"])
        head = (
            f"<p><b>{title}</b>: {html.escape(s['status'])}, {s['steps']} steps to {s['time']:g} s, "
            f"energy drift {s['energy']['h_drift_max']:.1e}</p>"
        )
        warned = "".join(f"<p>&#9888; {html.escape(w)}</p>" for w in self.warnings)
        return (
            head
            + warned
            + _html_table(["model", "kind", "unknowns", "own step [s]"], models)
            + _html_table(["probe", "quantity", "unit", "last", "least", "largest"], probes)
        )
