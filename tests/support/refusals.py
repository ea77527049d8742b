"""Assert that code is refused with an error of a known kind."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from rigs.errors import RigError


@contextmanager
def refused(code: str, text: str = "") -> Iterator[pytest.ExceptionInfo[RigError]]:
    """Expect an error with a code of docs/errors.md and this text in its message, and yield it."""
    with pytest.raises(RigError) as error:
        yield error
    assert error.value.code == code and text in str(error.value), str(error.value)
