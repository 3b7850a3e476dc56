"""Scenes: files that say what is coupled, and what comes of running them."""

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
    """A value as TOML writes it."""
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
    """What a run tells while it goes on: a line on standard error, and its warnings as Python's.

    Derive from it to show progress elsewhere.
    """

    def __init__(self, show: bool = True) -> None:
        self.show = show
        self._last = 0.0
        self._shown = False

    def step(self, done: int, planned: int) -> None:
        """So many steps of so many are made."""
        self._line("steps", done, planned)

    def member(self, label: str, done: int, planned: int) -> None:
        """A run of a sweep begins, and so many are done."""
        self._line(f"{label}:", done, planned)

    def warning(self, text: str) -> None:
        """Something a user should know, the moment it is known."""
        self.end()
        warnings.warn(text, errors.Warning, stacklevel=5)

    def end(self) -> None:
        """Nothing more follows."""
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
        # What was computed until Ctrl-C is not lost.
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

    After a wave has run there and back, the tip has moved twice as far as at rest, 2 F L/(E A):

    >>> bool(abs(run.probes["tip"].u[-1] / (2 * 1e3 / (210e9 * 1e-4)) - 1) < 0.02)
    True
    >>> bool(abs(run.energy.drift).max() < 1e-9)
    True

    Mistakes have the name of the matter and the line of the file:

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
        """A scene from a text; paths in it are relative to the current folder."""
        return cls._of(_native.Scene.from_text(text, _assignments(changes)))

    def set(self, path: str, value: Any) -> Scene:
        """The same scene with another value at a path such as ``time.end`` or ``support.0.model``."""
        return self.changed(**{path: value})

    def changed(self, **changes: Any) -> Scene:
        """The same scene with several values changed, by their paths."""
        return self._of(self._native.with_changes(_assignments(changes)))

    @property
    def path(self) -> Path:
        """Its file."""
        return Path(self._native.path)

    @property
    def text(self) -> str:
        """Its text, without the changes."""
        return self._native.text

    @property
    def title(self) -> Optional[str]:
        """Its title."""
        return self._native.title

    @property
    def changes(self) -> list[str]:
        """The changes made to it, as ``PATH=VALUE``."""
        return self._native.changes

    def check(self) -> Record:
        """Builds the scene and says what its run will be: models, interfaces, step, memory, time; runs nothing."""
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

        :param progress: whether to show how far it is.
        :param frames: about how many states to keep for :meth:`Run.fields`; by default as many as the scene writes,
            0 for none.
        :param out: folder of results, as ``arlequin run --out`` writes it; by default nothing is written.
        :param force: whether to replace earlier results there.

        Ctrl-C ends it with :class:`KeyboardInterrupt`, whose attribute ``run`` has what was computed; a run with ``out``
        goes on with :func:`resume`. Warnings are those of Python, :class:`arlequin.errors.Warning`.
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
        """Proposes settings of the coupling for an error or a time: ``given`` and ``proposed`` with what is predicted of
        them, ``set`` with the values to change.

        :param error: largest relative error against the fine model everywhere, such as 0.02.
        :param time: longest time of set-up and steps [s].
        :param frequency: highest frequency of interest [Hz], if loads do not tell.
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
    # `Any` in the type of `progress`: types of unpacked dictionaries are held against each named argument.
    return Scene(path, **changes).run(progress=progress)


def resume(folder: PathLike, *, progress: Union[bool, Progress] = False) -> Run:
    """Goes on with the run of a folder that was interrupted or killed, from its last checkpoint."""
    listener = _listener(progress)
    try:
        return _finished(_native.resume(os.fspath(folder), listener))
    finally:
        listener.end()


class Sweep(Record):
    """What a sweep found: ``sweep.json`` with attributes. ``runs`` has one entry per run."""

    def column(self, name: str) -> list[Any]:
        """One value of every run that is complete, such as ``error_judged``, ``cost`` or a parameter; None for a run that does not
        have it, as a reference run has no parameters.
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

    :param out: folder of the results; finished runs in it are taken again. Default: ``results/`` and the name.
    :param fresh: whether to make all runs again.

    Times are those of this process, which may do other things; ``arlequin sweep`` gives each run a process of its own.
    """
    listener = _listener(progress)
    folder = os.fspath(out) if out is not None else os.path.join("results", Path(path).stem)
    try:
        return Sweep(record(_native.sweep(os.fspath(path), folder, fresh, listener)))
    finally:
        listener.end()
