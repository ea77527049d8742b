"""Which cases of a test each commit has; the others are for `scripts/dev nightly`."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from typing import Any

import pytest

NIGHT_IS_OVER = "the night is over"
"""Why a test of `scripts/dev nightly` is skipped after its last hour."""


def cases(every: Iterable[Any], in_each_commit: Collection[Any] | Callable[[Any], bool]) -> list[Any]:
    """Return parameters for `pytest.mark.parametrize`, a tuple being a case of several: those that are not among the
    chosen ones are marked `nightly`."""
    chosen = in_each_commit if callable(in_each_commit) else in_each_commit.__contains__
    return [
        pytest.param(*(one if isinstance(one, tuple) else (one,)), marks=() if chosen(one) else pytest.mark.nightly)
        for one in every
    ]
