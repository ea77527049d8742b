"""Numbers of retired generators, in tests/tables: a line of JSON, then steps of columns in four planes of bytes."""

from __future__ import annotations

import json
import lzma
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray


class Archive:
    """A file NAME.xz, whose numbers are taken in their order."""

    def __init__(self, name: str) -> None:
        with lzma.open(Path(__file__).parents[1] / "tables" / f"{name}.xz") as file:
            self.about: Any = json.loads(file.readline())
            self._numbers, self._at = file.read(), 0

    def columns(self, measured: dict[str, Any]) -> dict[str, NDArray[np.float64]]:
        """The next columns, given as shape and size of a step."""
        found = {}
        for name, (shape, step) in measured.items():
            size = 4 * int(np.prod(shape))
            planes = np.frombuffer(self._numbers[self._at : self._at + size], np.uint8).reshape(4, -1)
            found[name] = step * np.cumsum(planes.T.copy().view("<i4").reshape(shape), axis=0)
            self._at += size
        return found
