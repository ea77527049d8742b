"""Pose tables of instruments, controllers and public data sets: measured files, and simulated files in such formats.

The simulated files are in `tests/tables/foreign.tar.xz`, with the expected result of each import. Their positions come
from independent kinematics with errors of a healthy arm, an unknown frame and tool, and tracker noise.
"""

from __future__ import annotations

import io
import tarfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Literal

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from analysis import load_run
from analysis.runs.tables import PoseTable, Table
from tests.support.command_line import ran

Array = NDArray[np.float64]
DATA = Path(__file__).parents[3] / "shared" / "data"
TABLES = Path(__file__).parents[1] / "tables"
Outcome = Literal["without a word", "one question", "not"]
UR5 = """name: ur5-tracker
robot:
  name: Universal Robots UR5
  axes:
    - {name: base, d_mm: 89.159, limits_deg: [-360, 360], speed_deg_s: 180}
    - {name: shoulder, alpha_deg: 90, limits_deg: [-360, 360], speed_deg_s: 180}
    - {name: elbow, a_mm: -425, limits_deg: [-360, 360], speed_deg_s: 180}
    - {name: wrist 1, a_mm: -392.25, d_mm: 109.15, limits_deg: [-360, 360], speed_deg_s: 180}
    - {name: wrist 2, alpha_deg: 90, d_mm: 94.65, limits_deg: [-360, 360], speed_deg_s: 180}
    - {name: wrist 3, alpha_deg: -90, d_mm: 82.3, limits_deg: [-360, 360], speed_deg_s: 180}
"""


@dataclass(frozen=True)
class Poses:
    """Poses measured by a tracker: q (n, 6) rad, xyz_mm (n, 3), rotations (n,) in its frame."""

    q: Array
    xyz_mm: Array
    turn: Rotation

    @property
    def quat(self) -> Array:
        """Rotations as quaternions (n, 4), x, y, z, w."""
        return np.asarray(self.turn.as_quat())


@dataclass(frozen=True)
class Foreign:
    """A table of one or more files. files: content by name, or the path of a measured file; truth: None for measured
    files; words: description; options: of the command, in addition to the files; asks: keys of the map left to
    the user.
    """

    name: str
    words: str
    real: bool
    outcome: Outcome
    files: Mapping[str, bytes | Path]
    rig: str = "ur10e-cell"
    options: tuple[str, ...] = ()
    asks: tuple[str, ...] = ()
    truth: Poses | None = None

    @property
    def is_here(self) -> bool:
        """True if the files exist on this computer."""
        return all(not isinstance(one, Path) or one.is_file() for one in self.files.values())

    def written(self, folder: Path) -> list[Path]:
        """Paths of the files, after writing simulated files into a directory."""
        paths = []
        for name, content in self.files.items():
            paths.append(content if isinstance(content, Path) else folder / name)
            if isinstance(content, bytes):
                paths[-1].write_bytes(content)
        return paths


@dataclass(frozen=True)
class Tried:
    """Result of importing a table: outcome, output, and whether the imported data are wrong."""

    outcome: Outcome
    said: str
    asked: tuple[str, ...] = ()
    wrong: str = ""


def tried(foreign: Foreign, folder: Path) -> Tried:
    """Import a table in a new directory without a user to answer questions."""
    (folder / "ur5.yaml").write_text(UR5)
    rig = folder / "ur5.yaml" if foreign.rig == "ur5" else foreign.rig
    files = foreign.written(folder)
    done = ran("import", *files, "--rig", rig, "--test", "pose", "-o", folder / "run", *foreign.options, cwd=folder)
    maps = list(folder.glob("*.map.yaml"))
    if done.returncode:
        asked = tuple(
            line.split(":")[0] for one in maps for line in one.read_text().splitlines() if line.endswith('"?"')
        )
        return Tried("one question" if len(asked) == 1 else "not", done.stderr, asked)
    told = "move too little to show order and signs" in done.stderr
    wrong = "" if told else _wrong(foreign.truth, load_run(folder / "run").table)
    return Tried("without a word", done.stderr, wrong=wrong)


def _wrong(truth: Poses | None, table: Table) -> str:
    """Describe import errors beyond the rounding of the file; empty if the truth is unknown."""
    if truth is None or not isinstance(table, PoseTable):
        return ""
    found = []
    if np.abs(table.q - truth.q).max() > 1e-5:
        found.append("joints")
    if np.abs(table.xyz_mm - truth.xyz_mm).max() > 0.01:
        found.append("places")
    if table.rpy is not None and (Rotation.from_euler("xyz", table.rpy) * truth.turn.inv()).magnitude().max() > 1e-4:
        found.append("turns")
    return ", ".join(found)


def text(rows: Sequence[Sequence[object]], header: Sequence[str] = (), sep: str = ",", comma: bool = False) -> bytes:
    """Format rows as a text file; comma: use decimal commas."""
    lines = [sep.join(header)] if header else []
    for row in rows:
        cells = [f"{one:.6f}" if isinstance(one, float) else str(one) for one in row]
        lines.append(sep.join(cell.replace(".", ",") if comma else cell for cell in cells))
    return ("\n".join(lines) + "\n").encode()


def rows(*columns: Array) -> list[list[float]]:
    """Return columns (n, k) side by side as rows of floats."""
    return np.column_stack(columns).tolist()


@cache
def _members() -> dict[str, bytes]:
    return members(TABLES / "foreign.tar.xz")


def members(archive: Path) -> dict[str, bytes]:
    """Files of an archive by name."""
    with tarfile.open(archive) as files:
        return {one.name: files.extractfile(one).read() for one in files}  # type: ignore[union-attr]


@cache
def poses() -> Poses:
    """Poses of the simulated files: an arm in the middle of its joint ranges, enough to distinguish all
    interpretations.
    """
    values = np.loadtxt(io.BytesIO(_members()["truth.csv"]), delimiter=",", skiprows=1)
    return Poses(values[:, :6], values[:, 6:9], Rotation.from_quat(values[:, 9:]))


def foreign_tables() -> list[Foreign]:
    """All tables: measured ones first, then simulated ones."""
    found = []
    for one in yaml.safe_load(_members()["tables.yaml"]):
        name, real = one["name"], one["real"]
        files = (
            {Path(path).name: DATA / path for path in one["files"]}
            if real
            else {file: _members()[f"{name}/{file}"] for file in one["files"]}
        )
        options, asks = (tuple(one.get(key, ())) for key in ("options", "asks"))
        truth = None if real else poses()
        found.append(Foreign(name, one["words"], real, one["outcome"], files, one["rig"], options, asks, truth))
    return found
