"""Errors by their codes."""

from contextlib import contextmanager

import pytest

from arlequin import errors


@contextmanager
def raises(code, match=None):
    """Like pytest.raises, for an error with this code; None stands for any."""
    with pytest.raises(errors.Error, match=match) as caught:
        yield caught
    assert code in (None, caught.value.code), f"{caught.value.code}: {caught.value}"
