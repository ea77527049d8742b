"""Files of a person: tables written as other programs write them, and results read without the product."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

JOINTS = tuple(f"q{axis}_deg" for axis in range(1, 7))
PLACES, TURNS = ("x_mm", "y_mm", "z_mm"), ("rx_deg", "ry_deg", "rz_deg")


def write_columns(path: Path, names: Sequence[str], *columns: Any) -> Path:
    """Columns of numbers or words, each (n,) or (n, k), in this order."""
    rows = np.column_stack([np.asarray(one, dtype=object) for one in columns])
    np.savetxt(path, rows, delimiter=",", comments="", header=",".join(names), fmt="%s")
    return path


def rows_in(path: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))


def numbers_in(path: Path, *names: str) -> NDArray[np.float64]:
    """Values (n, k) of the named columns; (n,) of one."""
    found = np.array([[float(row[name]) for name in names] for row in rows_in(path)])
    return found if len(names) > 1 else found[:, 0]


def contents(path: Path) -> Any:
    """What a file of JSON or YAML holds."""
    text = path.read_text(encoding="utf-8")
    return json.loads(text) if path.suffix == ".json" else yaml.safe_load(text)
