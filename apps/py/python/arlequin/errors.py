"""Exceptions of arlequin. Each message names the object, the value, the limit and a remedy.

All exceptions derive from :class:`Error`: :class:`InputError` (a :class:`ValueError`) if the input is wrong,
:class:`RunError` (a :class:`RuntimeError`) if the run failed. ``code`` is the name of the error in Rust:

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
    """Base class of all exceptions of arlequin."""

    code: str
    """Name of the error in Rust, such as ``"UnstableStep"``."""
    key: Optional[str]
    """Key of the scene that the error concerns, if any."""
    line: Optional[int]
    """Line of the scene file, from 1, if it is known."""

    def __init__(self, message: str, code: str = "", key: Optional[str] = None, line: Optional[int] = None) -> None:
        super().__init__(message)
        self.code, self.key, self.line = code or type(self).__name__, key, line

    def __reduce__(self) -> tuple[type, tuple[str, str, Optional[str], Optional[int]]]:
        return type(self), (str(self), self.code, self.key, self.line)


class InputError(Error, ValueError):
    """The input is wrong."""


class RunError(Error, RuntimeError):
    """The run or the system failed."""


class Busy(RunError):
    """Another thread is computing with this object."""


class InternalError(Error):
    """A programming error in arlequin."""


class Warning(UserWarning):  # noqa: A001 - a warning of this package, as numpy and others name theirs
    """A warning about a run."""


# Codes of errors that wrong input does not cause.
_RUN = frozenset(
    """
    Write Interrupted NotFinite System Observer NotSettled Diverged EnergyGrowth
    EnergyLoss ImpulseMissed MultipliersUnsolved Silent Closed Stranger Version Unexpected Length Content
    Failed Mass Heavier Broken Agreed Elsewhere
    """.split()
)


def _make(code: str, message: str, key: Optional[str], line: Optional[int]) -> Error:
    """Returns the exception for an error with this code."""
    named = {"InternalError": InternalError, "Busy": Busy}
    kind = named.get(code, RunError if code in _RUN else InputError)
    return kind(message, code, key, line)
