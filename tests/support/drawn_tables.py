"""Random pose tables in the formats of real exporters, correct or with a known defect, each with its true values.

They are in `tests/tables/drawn.tar.xz`. The formats follow the manuals of makers and the exporters of trackers, ROS and
spreadsheets. The arms use independent kinematics and typical errors of healthy arms, and are measured from a random
place by a noisy tracker. The generator is in commit c4a8d02a.
"""

from __future__ import annotations

import io
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from analysis import load_run
from analysis.runs.loading import load_measured
from analysis.runs.tables import PathTable, PoseTable
from rigs.arms import load_arm
from tests.support.command_line import ran
from tests.support.foreign_tables import TABLES, Poses, members
from tests.worlds.arms.independent_arm import Constants, constants_from, flange, healthy

Array = NDArray[np.float64]
Outcome = Literal[
    "without a word", "with a word", "question", "question, right answer offered", "wrong guess",
    "refused",
]  # fmt: skip
_LAST_DIGIT_MM, _LAST_DIGIT_RAD = 0.011, 2e-5
"""Largest rounding of a position and an angle by the digits of a file."""


@dataclass(frozen=True)
class Drawn:
    """A table and its true content. files: content by name; says: regular expression for the message required when
    it is imported, empty if nothing is wrong; sound: True if a correct import exists; answer: regular expression for
    the right answer to a question; controller_mm: places that the controller computed, if the table has them.
    """

    arm: str
    exporter: str
    trouble: str
    files: dict[str, bytes]
    q: Array
    xyz_mm: Array
    says: str = ""
    sound: bool = True
    options: tuple[str, ...] = ()
    test: str = "pose"
    answer: str = ""
    controller_mm: Array | None = None


@dataclass(frozen=True)
class Judged:
    """Result of importing a table. wrong: description of an unreported error, otherwise empty; lines: printed
    output.
    """

    outcome: Outcome
    wrong: str
    lines: str


def drawn_tables() -> dict[str, Drawn]:
    """All tables by name."""
    files = members(TABLES / "drawn.tar.xz")
    found = {}
    for about in yaml.safe_load(files["tables.yaml"]):
        name = about.pop("name")
        about["files"] = {file: files[f"{name}/{file}"] for file in about["files"]}
        about["options"] = tuple(about.get("options", ()))
        truth = files.get(f"{name}/truth.csv")
        values = np.loadtxt(io.BytesIO(truth), delimiter=",", skiprows=1) if truth else np.zeros((0, 9))
        controller_mm = values[:, 9:] if values.shape[1] > 9 else None
        found[name] = Drawn(**about, q=values[:, :6], xyz_mm=values[:, 6:9], controller_mm=controller_mm)
    return found


def constants(arm: str) -> Constants:
    """Constants of a library arm for the independent kinematics."""
    return constants_from(yaml.safe_load(load_arm(arm).text)["robot"])


def postures(arm: str, count: int, rng: np.random.Generator) -> Array:
    """Return random joint angles (count, 6) rad in the middle part of their limits."""
    axes = yaml.safe_load(f"name: arm\n{load_arm(arm).text}")["robot"]["axes"]
    low, high = np.radians([np.clip(axis["limits_deg"], -150, 150) for axis in axes]).T
    share = rng.uniform(0.25, 0.9)
    return (low + high) / 2 + share * (high - low) / 2 * rng.uniform(-1, 1, (count, 6))


def seen_by_tracker(arm: str, count: int, rng: np.random.Generator) -> Poses:
    """Return random poses of a healthy arm, measured by a tracker at an unknown place."""
    return _seen(arm, rng, postures(arm, count, rng))


def _seen(arm: str, rng: np.random.Generator, q: Array) -> Poses:
    R, p = flange(constants(arm), healthy(rng), q)
    base, tool = Rotation.random(rng=rng), Rotation.random(rng=rng)
    noise_mm = float(np.exp(rng.uniform(np.log(0.008), np.log(0.05))))
    place = p + R @ rng.uniform([-80, -80, 40], [80, 80, 250]) + rng.normal(0, noise_mm, p.shape)
    tilt = Rotation.from_rotvec(rng.normal(0, np.radians(0.01), p.shape))
    return Poses(q, base.apply(place) + rng.uniform(-3000, 3000, 3), base * tilt * Rotation.from_matrix(R) * tool)


def judged(drawn: Drawn, folder: Path) -> Judged:
    """Import a table in a new directory without a user to answer questions, and compare the result with the truth."""
    tests = "tests: {iso9283: {}}\n" * (drawn.test == "path")
    (folder / "arm.yaml").write_text(f"name: arm\n{load_arm(drawn.arm).text}{tests}", encoding="utf-8")
    for name, content in drawn.files.items():
        (folder / name).write_bytes(content)
    done = ran(*_command(drawn), "-o", "run", cwd=folder)
    if done.returncode and list(folder.glob("*.map.yaml")):
        return Judged(_asked(drawn, folder), "", done.stderr)
    if done.returncode:
        return Judged("refused", "", done.stderr)
    doubts = "\n".join(line for line in done.stderr.splitlines() if line.startswith("doubt:"))
    outcome: Outcome = "with a word" if doubts else "without a word"
    return Judged(outcome, _wrong(drawn, folder / "run", doubts), done.stderr)


def _command(drawn: Drawn) -> list[str]:
    return ["import", *drawn.files, "--rig", "arm.yaml", "--test", drawn.test, *drawn.options]


def _asked(drawn: Drawn, folder: Path) -> Outcome:
    """True if the most likely answer to a question of the import gives the true joints, if a correct answer
    exists.
    """
    if drawn.sound and ran(*_command(drawn), "-o", "assumed", "--yes", cwd=folder).returncode == 0:
        table = load_run(folder / "assumed").table
        assert isinstance(table, PoseTable)
        away_mm = float(np.abs(table.xyz_mm - drawn.xyz_mm).max())
        if _turned(table.q, drawn.q) > _LAST_DIGIT_RAD or (drawn.controller_mm is not None and away_mm > 1):
            offered = next(folder.glob("*.map.yaml")).read_text()
            is_offered = re.search(drawn.answer, offered) if drawn.answer else drawn.controller_mm is not None
            return "question, right answer offered" if is_offered else "wrong guess"
    return "question"


def _turned(q: Array, q_true: Array) -> float:
    """Largest difference between angles (n, 6) rad, modulo a full turn."""
    return float(np.abs((q - q_true + np.pi) % (2 * np.pi) - np.pi).max())


def _wrong(drawn: Drawn, run: Path, doubts: str) -> str:
    """A description of the unreported errors in an imported run."""
    table = load_run(run).table
    if drawn.says:
        return "" if re.search(drawn.says, doubts) else f"says nothing of {drawn.trouble}"
    if (
        drawn.trouble == "wrists a turn elsewhere"
    ):  # the joints equal those of the arm modulo a turn, and the rows are named
        if "whole turn" not in doubts:
            return f"says nothing of {drawn.trouble}"
        doubts = "\n".join(line for line in doubts.splitlines() if "whole turn" not in line)
    if isinstance(table, PathTable):
        return f"a word about a sound path: {doubts}" if re.search("outlier|repeat|equal the previous", doubts) else ""
    assert isinstance(table, PoseTable)
    if "assumed" in doubts or "taken as they are named" in doubts or "doubt: joints" in doubts:
        return ""
    if not drawn.sound:
        return f"{drawn.trouble}: imported"
    off = [
        "joints" * (_turned(table.q, drawn.q) > _LAST_DIGIT_RAD),
        "places" * bool(np.abs(table.xyz_mm - drawn.xyz_mm).max() > _LAST_DIGIT_MM),
        "the controller's places" * _has_wrong_controller(drawn, run),
    ]
    return ", ".join(filter(None, off)) or (f"a word about a sound table: {doubts}" if doubts else "")


def _has_wrong_controller(drawn: Drawn, run: Path) -> bool:
    """True if the run has places of the controller that are not those of the table."""
    table, names = load_measured(run).run.table, [f"controller_{axis}_mm" for axis in "xyz"]
    if table is None or names[0] not in table.column_names:
        return False
    kept = np.stack([table[name] for name in names], axis=1)
    return drawn.controller_mm is None or bool(np.abs(kept - drawn.controller_mm).max() > _LAST_DIGIT_MM)
