"""Measured poses and touches of real arms (shared/data), read as their authors publish them; nothing here is of rig.

UR10: Fraunhofer IPA, laser tracker. UR5, WAM: P. Jacobi. Pandas, iiwa 14: MUKCa (TU Delft), a ball in two sockets.
"""

from __future__ import annotations

import csv
from collections import defaultdict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Texts = NDArray[np.str_]
DATA = Path(__file__).parents[3] / "shared" / "data"
"""Default directory; the data are not part of the project."""
MUKCA_ARMS = {"panda_1": "franka-fr3", "panda_2": "franka-fr3", "kuka_14": "kuka-lbr-iiwa-14"}
"""Arms of the library. The Panda has the lengths of the FR3; its other masses only scale the compliance."""
UR5 = {"a_mm": (0, 0, -425, -392.25, 0, 0), "d_mm": (89.159, 0, 0, 109.15, 94.65, 82.3),
       "alpha_deg": (0, 90, 0, 0, 90, -90)}  # fmt: skip
"""Modified Denavit-Hartenberg constants by the maker's table of parameters."""
_UR10_LINKS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")


def ur10_columns(path: Path, *names: str) -> Array:
    """Columns (n, k) of a series of the UR10, which has decimal commas."""
    with path.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file, delimiter=";"))
    return np.array([[float(row[name].replace(",", ".")) for name in names] for row in rows])


def ur10(path: Path) -> tuple[Array, Array]:
    """Joint angles (n, 6) rad and measured places (n, 3) mm of a series of the UR10."""
    joints = [f"{link}_joint" for link in _UR10_LINKS]
    return ur10_columns(path, *joints), ur10_columns(path, *(f"measurement_{axis}" for axis in "xyz"))


def jacobi(path: Path) -> tuple[Array, Array]:
    """Commanded joint angles (n, axes) rad and measured places (n, 3) mm: target minus residual."""
    rows = np.genfromtxt(path, delimiter=",", names=True)
    column = {name.lower(): rows[name] for name in rows.dtype.names}
    axes = sum(name.startswith("joint_") for name in column)
    q = np.radians(np.stack([column[f"joint_{k}"] for k in range(1, axes + 1)], axis=1))
    return q, np.stack([column[f"{axis}_t"] - column[f"{axis}_dif"] for axis in "xyz"], axis=1)


def mukca(folder: Path, arm: str) -> dict[str, tuple[Texts, Array]]:
    """Sockets (n,) and joint angles (n, 7) rad of the touches of an arm, by placement."""
    parts: dict[str, list[tuple[str, Array]]] = defaultdict(list)
    for path in sorted(folder.glob(f"{arm}_*_hole_?.csv")):
        placement, _, hole = path.stem.removeprefix(f"{arm}_").rpartition("_hole_")
        parts[placement].append((hole, np.loadtxt(path, delimiter=",", ndmin=2)))
    return {
        placement: (np.concatenate([np.full(len(q), hole) for hole, q in own]), np.concatenate([q for _, q in own]))
        for placement, own in parts.items()
    }
