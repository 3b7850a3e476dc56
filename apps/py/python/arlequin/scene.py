"""Scenes: files that describe coupled models, and functions that run them."""

from __future__ import annotations

import json
import os
import sys
import time
import warnings
from pathlib import Path
from typing import Any, Iterable, Mapping, Optional, Union

from . import _native, errors
from .results import Record, Run, record

PathLike = Union[str, "os.PathLike[str]"]

__all__ = ["Scene", "Sweep", "resume", "run", "sweep"]


def _toml(value: Any) -> str:
    """Returns a value as TOML."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        return repr(value)
    if isinstance(value, (str, os.PathLike)):
        return json.dumps(os.fspath(value), ensure_ascii=False)
    if isinstance(value, Mapping):
        pairs = (f"{json.dumps(str(k), ensure_ascii=False)} = {_toml(v)}" for k, v in value.items())
        return "{ " + ", ".join(pairs) + " }"
    if isinstance(value, Iterable):
        return "[" + ", ".join(_toml(v) for v in value) + "]"
    raise errors.InputError(f"{value!r} is no value of a scene: give a number, a text, true or false, a list or a dictionary", code="Value")


def _assignments(changes: Mapping[str, Any]) -> list[tuple[str, str]]:
    return [(path, _toml(value)) for path, value in changes.items()]


class Progress:
    """Progress of a run: a line on standard error, and warnings as Python warnings.

    Derive a class from it to show progress elsewhere.
    """

    def __init__(self, show: bool = True) -> None:
        self.show = show
        self._last = 0.0
        self._shown = False

    def step(self, done: int, planned: int) -> None:
        """``done`` of ``planned`` steps are made."""
        self._line("steps", done, planned)

    def member(self, label: str, done: int, planned: int) -> None:
        """The run ``label`` of a sweep begins, after ``done`` of ``planned`` runs."""
        self._line(f"{label}:", done, planned)

    def warning(self, text: str) -> None:
        """Issues a warning as soon as it is known."""
        self.end()
        warnings.warn(text, errors.Warning, stacklevel=5)

    def end(self) -> None:
        """Removes the line: the work has ended."""
        if self._shown:
            print("\r" + " " * 60 + "\r", end="", file=sys.stderr, flush=True)
        self._shown = False

    def _line(self, what: str, done: int, planned: int) -> None:
        now = time.monotonic()
        if not self.show or now - self._last < 0.1:
            return
        self._last, self._shown = now, True
        filled = 30 * done // max(planned, 1)
        bar = "#" * filled + "-" * (30 - filled)
        print(f"\r{what} [{bar}] {done}/{planned} ", end="", file=sys.stderr, flush=True)


def _listener(progress: Union[bool, Progress]) -> Progress:
    if isinstance(progress, Progress):
        return progress
    if not isinstance(progress, bool):
        raise errors.InputError(f"progress = {progress!r}: give True, False or an arlequin.Progress", code="Value")
    return Progress(progress)


def _finished(made: tuple[_native.Results, Optional[BaseException]]) -> Run:
    results, stop = made
    run = Run(results)
    if stop is not None:
        # Results up to Ctrl-C are not lost.
        stop.run = run  # type: ignore[attr-defined]
        raise stop
    return run


class Scene:
    """A scene: its file, and changes made to it.

    :param path: the scene file.
    :param changes: new values by their paths in the file, such as ``**{"time.end": 1e-4}``; numbers in SI units,
        texts, lists, dictionaries and numpy arrays.

    >>> scene = Scene.from_text('''
    ... [model.bar]
    ... kind = "fem"
    ... shape.bar = { from = 0.0, to = 1.0, section = 1e-4 }
    ... spacing = 0.01
    ... material = { young = 210e9, density = 7800.0 }
    ... [[support]]
    ... model = "bar"
    ... where = "x-min"
    ... [[load]]
    ... model = "bar"
    ... where = "x-max"
    ... force = [1e3, 0.0, 0.0]
    ... time = "step"
    ... [time]
    ... end = 1e-3
    ... [probe.tip]
    ... model = "bar"
    ... where = "x-max"
    ... component = "x"
    ... ''')
    >>> run = scene.set("time.end", 3.854e-4).run()

    When the wave has returned to the tip, the tip has moved twice as far as under a static load, 2 F L/(E A):

    >>> bool(abs(run.probes["tip"].u[-1] / (2 * 1e3 / (210e9 * 1e-4)) - 1) < 0.02)
    True
    >>> bool(abs(run.energy.drift).max() < 1e-9)
    True

    Errors name the fault and the line of the file:

    >>> scene.set("time.ende", 1.0)
    Traceback (most recent call last):
        ...
    arlequin.errors.InputError: ...
    """

    def __init__(self, path: PathLike, **changes: Any) -> None:
        self._native = _native.Scene.read(os.fspath(path), _assignments(changes))

    @classmethod
    def _of(cls, native: _native.Scene) -> Scene:
        out = cls.__new__(cls)
        out._native = native
        return out

    @classmethod
    def from_text(cls, text: str, **changes: Any) -> Scene:
        """Returns a scene from a text; paths in it are relative to the current folder."""
        return cls._of(_native.Scene.from_text(text, _assignments(changes)))

    def set(self, path: str, value: Any) -> Scene:
        """Returns the scene with another value at a path such as ``time.end`` or ``support.0.model``."""
        return self.changed(**{path: value})

    def changed(self, **changes: Any) -> Scene:
        """Returns the scene with several values changed, given by their paths."""
        return self._of(self._native.with_changes(_assignments(changes)))

    @property
    def path(self) -> Path:
        """Scene file."""
        return Path(self._native.path)

    @property
    def text(self) -> str:
        """Text of the file, without the changes."""
        return self._native.text

    @property
    def title(self) -> Optional[str]:
        """Title of the scene."""
        return self._native.title

    @property
    def changes(self) -> list[str]:
        """Changes made to the file, as ``PATH=VALUE``."""
        return self._native.changes

    def check(self) -> Record:
        """Builds the scene and returns the plan of its run: models, interfaces, step, memory, time. Makes no steps."""
        return record(self._native.check())

    def run(
        self,
        *,
        progress: Union[bool, Progress] = False,
        frames: Optional[int] = None,
        out: Optional[PathLike] = None,
        force: bool = False,
    ) -> Run:
        """Makes all steps.

        :param progress: whether to show progress.
        :param frames: approximate number of states to keep for :meth:`Run.fields`; by default as many as the scene
            writes, 0 for none.
        :param out: folder of results, as ``arlequin run --out`` writes it; by default nothing is written.
        :param force: whether to replace earlier results there.

        Ctrl-C ends the run with :class:`KeyboardInterrupt`, whose attribute ``run`` has the results so far; :func:`resume`
        continues a run with ``out``. Warnings are Python warnings of the class :class:`arlequin.errors.Warning`.
        """
        listener = _listener(progress)
        folder = None if out is None else os.fspath(out)
        try:
            return _finished(self._native.run(frames, folder, force, listener))
        finally:
            listener.end()

    def suggest(
        self,
        *,
        error: Optional[float] = None,
        time: Optional[float] = None,
        frequency: Optional[float] = None,
        apply: Optional[PathLike] = None,
    ) -> Record:
        """Proposes settings of the coupling for an error or a time. Returns ``given`` and ``proposed`` settings with
        predictions for both, and in ``set`` the values to change.

        :param error: largest relative error against the fine model everywhere, such as 0.02.
        :param time: longest time of set-up and steps [s].
        :param frequency: highest frequency of interest [Hz], if the loads do not determine it.
        :param apply: file to write the scene with the proposed values to.
        """
        return record(self._native.suggest(error, time, frequency, None if apply is None else os.fspath(apply)))

    def __repr__(self) -> str:
        changes = "".join(f", {c}" for c in self.changes)
        return f"<arlequin.Scene {str(self.path)!r}{changes}>"

    def _repr_html_(self) -> str:
        return self.check()._repr_html_()


def run(path: PathLike, *, progress: Union[bool, Progress, Any] = False, **changes: Any) -> Run:
    """Runs a scene file: ``Scene(path, **changes).run(progress=progress)``, such as ``run("bar.toml", **{"time.end": 1e-4})``."""
    # `Any` in the type of `progress`: type checkers compare an unpacked dictionary with each named argument.
    return Scene(path, **changes).run(progress=progress)


def resume(folder: PathLike, *, progress: Union[bool, Progress] = False) -> Run:
    """Continues the run of a folder that was interrupted or killed, from its last checkpoint."""
    listener = _listener(progress)
    try:
        return _finished(_native.resume(os.fspath(folder), listener))
    finally:
        listener.end()


class Sweep(Record):
    """Results of a sweep: ``sweep.json`` with attributes. ``runs`` has one entry per run."""

    def column(self, name: str) -> list[Any]:
        """Returns one value of every complete run, such as ``error_judged``, ``cost`` or a parameter; None for a run without
        this value, such as a reference run, which has no parameters.
        """
        complete = [r for r in self["runs"] if r["status"] == "complete"]
        if not any(name in r["parameters"] or name in r for r in complete):
            known = sorted({n for r in complete for n in [*r, *r["parameters"]]})
            raise KeyError(f"no run has {name!r}; there are: {', '.join(known)}")
        return [r["parameters"].get(name, r.get(name)) for r in complete]


def sweep(
    path: PathLike, *, out: Optional[PathLike] = None, fresh: bool = False, progress: Union[bool, Progress] = False
) -> Sweep:
    """Makes the runs of a sweep file, one after another in this process.

    :param out: folder of the results; finished runs in it are used again. Default: ``results/`` and the name.
    :param fresh: whether to repeat all runs.

    Times are measured in this process, which may do other work; ``arlequin sweep`` runs each run in its own process.
    """
    listener = _listener(progress)
    folder = os.fspath(out) if out is not None else os.path.join("results", Path(path).stem)
    try:
        return Sweep(record(_native.sweep(os.fspath(path), folder, fresh, listener)))
    finally:
        listener.end()
