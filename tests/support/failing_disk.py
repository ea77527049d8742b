"""A disk with failing system calls, and the streams that recorder tests write to it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from daq.store import durable

COLUMNS = {"g1": ("g1_mm",), "g2": ("g2_mm",), "robot": ("q1_deg",)}


@contextmanager
def failing(number: int, *calls: str) -> Iterator[None]:
    """Make the system calls named in `calls` fail with an error number, except for opening files to read."""

    class Broken:
        def __getattr__(self, name: str) -> Any:
            return self._fail if name in calls else getattr(os, name)

        def _fail(self, *arguments: object) -> None:
            if arguments[1:2] != (os.O_RDONLY,):
                raise OSError(number, os.strerror(number))

    durable.os = Broken()  # type: ignore[assignment]
    try:
        yield
    finally:
        durable.os = os
