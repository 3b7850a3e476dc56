"""Exceptions of arlequin. Each says the object, the value, the limit and the way out.

Everything derives from :class:`Error`: :class:`InputError` (a :class:`ValueError`) if what was given is to blame,
:class:`RunError` (a :class:`RuntimeError`) if the run failed. ``code`` names the matter, as the error is called in Rust:

>>> import arlequin
>>> try:
...     arlequin.Elastic(young=-1.0, poisson=0.3, density=1.0)
... except arlequin.errors.InputError as e:
...     print(e.code)
InvalidParameter
"""

from __future__ import annotations

from typing import Optional


class Error(Exception):
    """Anything that arlequin raises."""

    code: str
    """Name of the matter, such as ``"UnstableStep"``."""
    key: Optional[str]
    """Key of the scene that the error is about, if any."""
    line: Optional[int]
    """Line of the scene's file, from 1, if it is known."""

    def __init__(self, message: str, code: str = "", key: Optional[str] = None, line: Optional[int] = None) -> None:
        super().__init__(message)
        self.code, self.key, self.line = code or type(self).__name__, key, line

    def __reduce__(self) -> tuple[type, tuple[str, str, Optional[str], Optional[int]]]:
        return type(self), (str(self), self.code, self.key, self.line)


class InputError(Error, ValueError):
    """What was given is to blame."""


class RunError(Error, RuntimeError):
    """The run failed, or the system did."""


class Busy(RunError):
    """The object computes already, in another thread."""


class InternalError(Error):
    """A mistake in arlequin itself."""


class Warning(UserWarning):  # noqa: A001 - a warning of this package, as numpy and others name theirs
    """Something a user should know of a run."""


# Codes of errors that the input is not to blame for.
_RUN = frozenset(
    """
    Write Interrupted NotFinite System Observer NotSettled Diverged EnergyGrowth
    EnergyLoss ImpulseMissed MultipliersUnsolved Silent Closed Stranger Version Unexpected Length Content
    Failed Mass Heavier Broken Agreed Elsewhere
    """.split()
)


def _make(code: str, message: str, key: Optional[str], line: Optional[int]) -> Error:
    """The exception for an error of this code."""
    named = {"InternalError": InternalError, "Busy": Busy}
    kind = named.get(code, RunError if code in _RUN else InputError)
    return kind(message, code, key, line)
