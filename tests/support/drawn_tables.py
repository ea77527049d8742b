"""Random pose tables in the formats of real exporters, correct or with a known defect, each with its true values.

The formats follow the manuals of makers and the exporters of trackers, ROS and spreadsheets. The arms use independent
kinematics and typical errors of healthy arms, and are measured from a random place by a noisy tracker. Every defect is
combined with every exporter.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
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
from tests.support.foreign_tables import Poses, rows, text
from tests.worlds.arms.independent_arm import Constants, flange, healthy, none

Array = NDArray[np.float64]
Outcome = Literal[
    "without a word", "with a word", "question", "question, right answer offered", "wrong guess",
    "refused",
]  # fmt: skip
ARMS = (
    "ur10e", "ur5e", "kuka-kr-6-r900-2", "fanuc-lr-mate-200id", "abb-irb-120", "staubli-tx2-60", "yaskawa-gp12",
    "kawasaki-rs007n", "doosan-m1013", "ufactory-xarm-6",
)  # fmt: skip
_UR = ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint")
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
    truth: Poses
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


@dataclass
class _Table:
    """Content of a table before it is written. Every field may be corrupted."""

    arm: str
    q: Array
    xyz_mm: Array
    turn: Rotation
    truth: Poses
    says: str = ""
    sound: bool = True
    more: dict[str, Sequence[object]] = field(default_factory=dict)
    bad: str = "nan"
    """Text for missing joint angles or positions."""
    answer: str = ""
    controller_mm: Array | None = None


def constants(arm: str) -> Constants:
    """Constants of a library arm for the independent kinematics."""
    robot = yaml.safe_load(f"name: arm\n{load_arm(arm).text}")["robot"]
    keys = ("a_mm", "alpha_deg", "d_mm", "offset_deg")
    a, alpha, d, offset = (np.array([float(axis.get(key, 0.0)) for axis in robot["axes"]]) for key in keys)
    coupling = np.array(robot.get("coupling", np.eye(6)), dtype=float)
    return Constants(a, np.radians(alpha), d, np.radians(offset), coupling)


def _postures(arm: str, count: int, rng: np.random.Generator) -> Array:
    """Return random joint angles (count, 6) rad in the middle part of their limits."""
    axes = yaml.safe_load(f"name: arm\n{load_arm(arm).text}")["robot"]["axes"]
    low, high = np.radians([np.clip(axis["limits_deg"], -150, 150) for axis in axes]).T
    share = rng.uniform(0.25, 0.9)
    return (low + high) / 2 + share * (high - low) / 2 * rng.uniform(-1, 1, (count, 6))


def seen_by_tracker(arm: str, count: int, rng: np.random.Generator) -> Poses:
    """Return random poses of a healthy arm, measured by a tracker at an unknown place."""
    return _seen(arm, rng, _postures(arm, count, rng))


def _seen(arm: str, rng: np.random.Generator, q: Array) -> Poses:
    R, p = flange(constants(arm), healthy(rng), q)
    base, tool = Rotation.random(rng=rng), Rotation.random(rng=rng)
    noise_mm = float(np.exp(rng.uniform(np.log(0.008), np.log(0.05))))
    place = p + R @ rng.uniform([-80, -80, 40], [80, 80, 250]) + rng.normal(0, noise_mm, p.shape)
    tilt = Rotation.from_rotvec(rng.normal(0, np.radians(0.01), p.shape))
    return Poses(q, base.apply(place) + rng.uniform(-3000, 3000, 3), base * tilt * Rotation.from_matrix(R) * tool)


# -- Defects. Each changes the content and states the message that an import must print. --


def _sound(t: _Table, rng: np.random.Generator) -> None:
    del t, rng


_TURNED = "wrists a turn elsewhere"


def _other_turns(t: _Table, rng: np.random.Generator) -> None:
    """Shift wrist joints by full turns in some rows."""
    t.q = t.q + 2 * np.pi * rng.integers(-1, 2, t.q.shape) * np.array([0, 0, 0, 1, 0, 1])


def _backwards(t: _Table, rng: np.random.Generator) -> None:
    t.q = t.q * np.where(np.arange(6) == rng.integers(6), -1.0, 1.0)


def _several_backwards(t: _Table, rng: np.random.Generator) -> None:
    """Count two to five axes in the opposite direction."""
    axes = np.sort(rng.choice(6, int(rng.integers(2, 6)), replace=False))
    t.q = t.q * np.where(np.isin(np.arange(6), axes), -1.0, 1.0)
    t.answer = rf"reversed: \[{', '.join(str(axis + 1) for axis in axes)}\]"


def _exchanged(t: _Table, rng: np.random.Generator) -> None:
    first, second = rng.choice(6, 2, replace=False)
    order = np.arange(6)
    order[[first, second]] = second, first
    t.q = t.q[:, order]


def _mirrored(t: _Table, rng: np.random.Generator) -> None:
    signs = np.where(np.arange(3) == rng.integers(3), -1.0, 1.0)
    t.xyz_mm = t.xyz_mm * signs
    t.turn = Rotation.from_matrix(np.diag(signs) @ t.turn.as_matrix() @ np.diag(signs))


def _zero_elsewhere(t: _Table, rng: np.random.Generator) -> None:
    axis = rng.integers(1, 5)
    t.q = t.q + np.where(np.arange(6) == axis, np.radians(rng.choice([90, -90])), 0.0)
    t.sound = False


def _coupled(t: _Table, rng: np.random.Generator) -> None:
    """Change the reference of joint 3 between the horizontal and axis 2, opposite to the rig file."""
    t.q = t.q.copy()
    t.q[:, 2] += rng.choice([-1, 1]) * t.q[:, 1]
    t.sound = False


_FAR = "ignored|from the position computed"
"""Words about rows that no arm explains."""


def _many_wild(t: _Table, rng: np.random.Generator) -> None:
    """Move up to a quarter of the places by 5 to 100 mm. Their rows must be ignored."""
    count = int(rng.integers(int(0.12 * len(t.q)) + 1, len(t.q) // 4 + 1))
    wild = rng.choice(len(t.q), count, replace=False)
    away = rng.normal(size=(count, 3))
    away *= np.exp(rng.uniform(np.log(5), np.log(100), (count, 1))) / np.linalg.norm(away, axis=1)[:, None]
    t.xyz_mm = t.xyz_mm.copy()
    t.xyz_mm[wild] += away
    t.says = f"{count} of {len(t.q)} poses ignored"


def _one_posture(t: _Table, rng: np.random.Generator) -> None:
    """Measure one to three postures again and again, as a test of the repeatability does."""
    few = rng.integers(0, int(rng.integers(1, 4)), len(t.q))
    t.q = t.q[few] + rng.normal(0, np.radians(0.001), t.q.shape)
    t.xyz_mm, t.turn = t.xyz_mm[few] + rng.normal(0, 0.02, t.xyz_mm.shape), t.turn[few]
    t.says, t.sound = "posture", False


def _wild(t: _Table, rng: np.random.Generator, sizes: tuple[float, float] = (1.0, 1000.0)) -> None:
    wild = rng.choice(len(t.q), 1 + int(rng.random() < 0.4), replace=False)
    away = rng.normal(size=(len(wild), 3))
    mm = np.exp(rng.uniform(*np.log(sizes), len(wild)))
    t.xyz_mm = t.xyz_mm.copy()
    t.xyz_mm[wild] += away * (mm / np.linalg.norm(away, axis=1))[:, None]
    t.says = "(?s)" + "".join(rf"(?=.*\b{row + 1}\b)" for row in wild) + f".*{_FAR}"


def _lost(t: _Table, rng: np.random.Generator) -> None:
    lost = rng.choice(len(t.q), 2, replace=False)
    t.xyz_mm = t.xyz_mm.copy()
    t.xyz_mm[lost] = 0.0
    t.says = "(?s)" + "".join(rf"(?=.*\b{row + 1}\b)" for row in lost) + ".*(0, 0, 0|ignored)"


def _sent_again(t: _Table, rng: np.random.Generator) -> None:
    row = int(rng.integers(5, len(t.q)))
    t.xyz_mm = t.xyz_mm.copy()
    t.xyz_mm[row] = t.xyz_mm[row - 1]
    t.says = rf"\b{row + 1}\b"


def _not_at_rest(t: _Table, rng: np.random.Generator) -> None:
    """Read the instrument before the tool has come to rest: the last rows lag behind."""
    count = int(rng.choice([2, 4, 6]))
    lag = rng.uniform(0.02, 0.2, count)[:, None]
    t.xyz_mm = t.xyz_mm.copy()
    t.xyz_mm[-count:] += lag * (t.xyz_mm[-count - 1 : -1] - t.xyz_mm[-count:])
    t.says = _FAR


def _computed(t: _Table, rng: np.random.Generator) -> None:
    """Replace the measured positions by those computed by the controller, for flange or tool, in the base or another
    frame.
    """
    own = none()
    own.offset[1:5] = np.radians(rng.normal(0, 0.05, 4))
    own.a[2:4], own.d[3:] = rng.normal(0, 0.5, 2), rng.normal(0, 0.3, 3)
    R, p = flange(constants(t.arm), own, t.truth.q)
    frame, tool_mm = Rotation.identity(), np.zeros(3)
    if rng.random() < 0.5:
        tool_mm = rng.uniform([-50, -50, 50], [50, 50, 200]).round(1)
    if rng.random() < 0.4:
        frame = Rotation.from_euler("z", rng.choice([180.0, 90.0, 37.0]), degrees=True)
    t.xyz_mm = frame.apply(p + R @ tool_mm).round(int(rng.choice([2, 3, 4])))
    t.turn = frame * Rotation.from_matrix(R)
    t.says, t.sound = "computed|controller|robot", False


def _two_reflectors(t: _Table, rng: np.random.Generator) -> None:
    """Use a second reflector on the same tool for half of the rows, in blocks or alternating."""
    second = np.arange(len(t.q)) % 2 == 1 if rng.random() < 0.5 else np.arange(len(t.q)) >= len(t.q) // 2
    place = rng.normal(size=3)
    place *= rng.uniform(20, 150) / np.linalg.norm(place)
    t.xyz_mm = t.xyz_mm + second[:, None] * t.turn.apply(place)
    t.says, t.sound = f"{_FAR}|target|reflector", False
    if rng.random() < 0.5:
        t.more["Target"] = np.where(second, "SMR 2", "SMR 1").tolist()


def _moved(t: _Table, rng: np.random.Generator) -> None:
    """Move the tracker after the first part."""
    later = np.arange(len(t.q)) >= int(len(t.q) * rng.uniform(0.4, 0.85))
    turn = Rotation.from_rotvec(rng.normal(0, np.radians(0.3), 3))
    t.xyz_mm = np.where(later[:, None], turn.apply(t.xyz_mm) + rng.normal(0, 8, 3), t.xyz_mm)
    t.says, t.sound = f"{_FAR}|different place", False


def _another_arm(t: _Table, rng: np.random.Generator) -> None:
    t.arm = str(rng.choice([arm for arm in ARMS if arm != t.arm]))
    t.sound = False


def _bad_cells(t: _Table, rng: np.random.Generator) -> None:
    """Insert invalid numbers in columns that the import uses."""
    t.q, t.xyz_mm = t.q.copy(), t.xyz_mm.copy()
    values = t.q if rng.random() < 0.5 else t.xyz_mm
    values[len(values) // 2, rng.integers(values.shape[1])] = np.nan
    t.bad, t.sound = str(rng.choice(["", "n/a", "###", "NaN", "1.2.3"])), False


TROUBLES: dict[str, tuple[Callable[[_Table, np.random.Generator], None], float]] = {
    "sound": (_sound, 8), _TURNED: (_other_turns, 2), "an axis the other way": (_backwards, 2),
    "two columns exchanged": (_exchanged, 2), "a left-handed frame": (_mirrored, 2),
    "a zero elsewhere": (_zero_elsewhere, 1), "joint 3 from the horizontal": (_coupled, 1), "wild rows": (_wild, 3),
    "lost places": (_lost, 1), "a place sent again": (_sent_again, 1), "not come to rest": (_not_at_rest, 2),
    "the controller's places": (_computed, 3), "two reflectors": (_two_reflectors, 2), "a tracker moved": (_moved, 1),
    "another arm": (_another_arm, 1), "bad cells": (_bad_cells, 1),
}  # fmt: skip
"""Defects by name: the function that applies it, and its relative frequency."""
NEW_TROUBLES: dict[str, tuple[Callable[[_Table, np.random.Generator], None], float]] = {
    "sound": (_sound, 3), "several axes the other way": (_several_backwards, 2), "many wild rows": (_many_wild, 2),
    "one posture": (_one_posture, 1), "the controller's places": (_computed, 1),
}  # fmt: skip
"""Defects that `drawn` adds on request, so that the tables of a seed stay the same."""


# -- Exporters: formats of the written table. --

_Files = tuple[dict[str, bytes], tuple[str, ...]]
_TO = {"mm": 1.0, "m": 1e-3, "cm": 0.1, "in": 1 / 25.4}


def _numbers(t: _Table, rng: np.random.Generator) -> tuple[Array, Array, str, str]:
    """Return joint angles and positions in a random unit, which the file may or may not state."""
    angle, length = str(rng.choice(["deg", "deg", "rad"])), str(rng.choice(["mm", "mm", "mm", "m", "m", "cm", "in"]))
    return (np.degrees(t.q) if angle == "deg" else t.q), t.xyz_mm * _TO[length], angle, length


def _written(
    header: Sequence[str], columns: Sequence[Array], t: _Table, rng: np.random.Generator, sep: str = ""
) -> bytes:
    """Format a text file with random separator, decimals, line ends and encoding."""
    sep = sep or str(rng.choice([",", ";", "\t"]))
    cells: list[list[object]] = [[t.bad if np.isnan(value) else value for value in row] for row in rows(*columns)]
    names = list(header)
    for name, values in t.more.items():
        names = [name, *names] if names else names
        cells = [[value, *row] for value, row in zip(values, cells, strict=True)]
    body = text(cells, names, sep, comma=sep == ";" and bool(rng.random() < 0.7)).decode()
    body = body.replace("\n", "\r\n") if rng.random() < 0.3 else body
    return body.encode(str(rng.choice(["utf-8", "utf-8", "utf-8-sig", "utf-16", "cp1252"])), errors="replace")


def _spreadsheet(t: _Table, rng: np.random.Generator) -> _Files:
    """Write the columns of a hand-made spreadsheet, with informal names."""
    q, xyz, angle, length = _numbers(t, rng)
    styles = ("J{}", "q{}", "joint_{}", "Joint {}", "theta{}", "A{}", "axis{}", "j{}_act", "Achse {}", "JT{}", "Q[{}]")
    joints = str(rng.choice(styles))
    place = str(rng.choice(["{}", "{}_meas", "measured_{}", "{}-Ist", "tracker.{}", "Meas {}", "pos_{}", "P{}"]))
    unit = str(rng.choice(["", " [{}]", " ({})", "_{}"]))
    names = [joints.format(k) + unit.format(angle) for k in range(1, 7)]
    seen = [place.format(axis) + unit.format(length) for axis in str(rng.choice(["xyz", "XYZ"]))]
    if rng.random() < 0.5:
        return {"poses.csv": _written([*names, *seen], [q, xyz], t, rng)}, ()
    return {"poses.csv": _written([*seen, *names], [xyz, q], t, rng)}, ()


def _pandas(t: _Table, rng: np.random.Generator) -> _Files:
    """Write the format of DataFrame.to_csv, with an unnamed first column."""
    q, xyz, _, _ = _numbers(t, rng)
    header = ["", *(f"q_{k}" for k in range(6)), "x", "y", "z"]
    return {"frame.csv": _written(header, [np.arange(len(q))[:, None], q, xyz], t, rng, ",")}, ()


def _headless(t: _Table, rng: np.random.Generator) -> _Files:
    """Write a file without header, as MATLAB's writematrix and numpy's savetxt do."""
    q, xyz, _, _ = _numbers(t, rng)
    pose = [xyz, t.turn.as_euler("xyz", degrees=True)] if rng.random() < 0.4 else [xyz]
    columns = [q, *pose] if rng.random() < 0.6 else [*pose, q]
    return {"data.txt": _written([], columns, t, rng, str(rng.choice([",", " ", "\t", ";"])))}, ()


def _two_headless(t: _Table, rng: np.random.Generator) -> _Files:
    q, xyz, _, _ = _numbers(t, rng)
    files = {"joints.csv": _written([], [q], replace(t, more={}), rng), "tracker.csv": _written([], [xyz], t, rng)}
    return dict(sorted(files.items(), reverse=bool(rng.random() < 0.4))), ("--join", "rows")


def _matrices(t: _Table, rng: np.random.Generator) -> _Files:
    q, _, _, _ = _numbers(t, rng)
    T = np.tile(np.eye(4), (len(q), 1, 1))
    T[:, :3, :3], T[:, :3, 3] = t.turn.as_matrix(), t.xyz_mm / 1e3
    header = [*(f"q_{k}" for k in range(1, 7)), *(f"T_{k}" for k in range(1, 17))]
    return {"T.csv": _written(header, [q, T.reshape(-1, 16)], t, rng, ",")}, ()


def _kuka(t: _Table, rng: np.random.Generator) -> _Files:
    header = [*(f"A{k}" for k in range(1, 7)), "X", "Y", "Z", "A", "B", "C"]
    abc = t.turn.as_euler("ZYX", degrees=True)
    return {"krc.csv": _written(header, [np.degrees(t.q), t.xyz_mm, abc], t, rng, ";")}, ()


def _fanuc(t: _Table, rng: np.random.Generator) -> _Files:
    header = ["X", "Y", "Z", "W", "P", "R", *(f"J{k}" for k in range(1, 7))]
    wpr = t.turn.as_euler("xyz", degrees=True)
    return {"pos.csv": _written(header, [t.xyz_mm, wpr, np.degrees(t.q)], t, rng, ",")}, ()


def _abb(t: _Table, rng: np.random.Generator) -> _Files:
    header = [*(f"rax_{k}" for k in range(1, 7)), "x", "y", "z", "q1", "q2", "q3", "q4"]
    quat = t.turn.as_quat()[:, [3, 0, 1, 2]]
    return {"targets.txt": _written(header, [np.degrees(t.q), t.xyz_mm, quat], t, rng, "\t")}, ()


def _by_name(t: _Table) -> tuple[list[str], list[int]]:
    """Joint names of a ROS driver, and the alphabetical order of the joints."""
    called = list(_UR) if t.arm.startswith("ur") else [f"joint_{k}" for k in range(1, 7)]
    return called, sorted(range(6), key=lambda k: called[k])


def _plotjuggler(t: _Table, rng: np.random.Generator) -> _Files:
    called, order = _by_name(t)
    header = [f"/joint_states/{called[k]}/{kind}" for kind in ("position", "velocity", "effort") for k in order]
    still, effort = rng.normal(0, 1e-4, t.q.shape), rng.normal(0, 5, t.q.shape)
    stamp = 1.7e9 + 5.0 * np.arange(len(t.q))[:, None]
    header = ["__time", *header, *(f"/{rng.choice(['leica', 'vicon', 'tracker'])}/point/{axis}" for axis in "xyz")]
    return {"plot.csv": _written(header, [stamp, t.q[:, order], still, effort, t.xyz_mm / 1e3], t, rng, ",")}, ()


def _rostopic(t: _Table, rng: np.random.Generator) -> _Files:
    called, order = _by_name(t)
    names = {f"field.name{k}": [called[order[k]]] * len(t.q) for k in range(6)}
    header = ["%time", *(f"field.position{k}" for k in range(6)), "x", "y", "z"]
    stamp = 1.7e9 + 5.0 * np.arange(len(t.q))[:, None]
    written = replace(t, more={**names, **t.more})
    return {"echo.csv": _written(header, [stamp, t.q[:, order], t.xyz_mm], written, rng, ",")}, ()


def _rtde(t: _Table, rng: np.random.Generator) -> _Files:
    """Write an RTDE recording: targets, currents and the controller's pose, with the position of the tracker added."""
    header = ["timestamp", *(f"target_q_{k}" for k in range(6)), *(f"actual_q_{k}" for k in range(6))]
    header += [f"actual_current_{k}" for k in range(6)] + [f"actual_TCP_pose_{k}" for k in range(6)]
    R, p = flange(constants(t.arm), none(), np.nan_to_num(t.q))
    robot, t.controller_mm = [p / 1e3, Rotation.from_matrix(R).as_rotvec()], p
    stamp, current = 0.5 * np.arange(len(t.q))[:, None], rng.normal(0, 2, t.q.shape)
    columns = [stamp, t.q + rng.normal(0, 1e-5, t.q.shape), t.q, current, *robot, t.xyz_mm / 1e3]
    header += [f"tracker_{axis}" for axis in "xyz"]
    return {"rtde.csv": _written(header, columns, t, rng, str(rng.choice([",", " "])))}, ()


def _analyzer(t: _Table, rng: np.random.Generator) -> _Files:
    """Write a report of tracker software with remarks, point names and uncertainties; the joints are in a second
    file.
    """
    header = ["Collection", "Group", "Point", "X [mm]", "Y [mm]", "Z [mm]", "Ux [mm]", "Uy [mm]", "Uz [mm]"]
    points = {"Point": [f"p{k}" for k in range(len(t.q))], "Group": ["Main"] * len(t.q), "Collection": ["A"] * len(t.q)}
    written = replace(t, more={**t.more, **points})
    names = [*header[3:]]
    body = _written(names, [t.xyz_mm, np.full(t.xyz_mm.shape, 0.012)], written, rng, ",")
    joints = text(rows(np.degrees(t.q)), [f"J{k}" for k in range(1, 7)])
    return {"report.csv": body, "joints.csv": joints}, ("--join", "rows")


def _decimal_comma_workbook(t: _Table, rng: np.random.Generator) -> _Files:
    """Write a workbook with numbers or with text cells containing decimal commas, optionally below a title."""
    import openpyxl  # noqa: PLC0415 - slow to import

    q, xyz, angle, length = _numbers(t, rng)
    book = openpyxl.Workbook()
    if rng.random() < 0.4:
        book.active.append(["Messung Zelle 4"])
    book.active.append([*(f"Achse {k} [{angle}]" for k in range(1, 7)), *(f"{axis} [{length}]" for axis in "XYZ")])
    is_text = rng.random() < 0.6
    for row in rows(q, xyz):
        cells: list[object] = [f"{value:.6f}".replace(".", ",") for value in row] if is_text else list(row)
        book.active.append([t.bad if np.isnan(value) else cell for value, cell in zip(row, cells, strict=True)])
    held = io.BytesIO()
    book.save(held)
    return {"Mappe1.xlsx": held.getvalue()}, ()


def _motion_capture(t: _Table, rng: np.random.Generator) -> _Files:
    """Write a motion capture export of one rigid body with its header lines, joined with the joints by row."""
    head = "Format Version,1.23,Take Name,Take 1,Export Frame Rate,240\n,,RigidBody,RigidBody,RigidBody\n"
    header = ["Frame", "Time", *(f"Rotation {axis}" for axis in "XYZW"), *(f"Position {axis}" for axis in "XYZ")]
    columns = [np.arange(len(t.q))[:, None], np.arange(len(t.q))[:, None] / 240, t.turn.as_quat(), t.xyz_mm]
    body = head.encode() + text(rows(*columns), header)
    joints = _written([f"q{k}" for k in range(1, 7)], [np.degrees(t.q)], t, rng, ",")
    return {"take.csv": body, "q.csv": joints}, ("--join", "rows")


def _commanded_too(t: _Table, rng: np.random.Generator) -> _Files:
    """Write commanded and measured values of joints and positions side by side."""
    header = [*(f"q{k}_cmd" for k in range(1, 7)), *(f"q{k}_act" for k in range(1, 7))]
    header += ["x_nom", "y_nom", "z_nom", "x_act", "y_act", "z_act"]
    nominal = t.xyz_mm + rng.normal(0, 0.7, t.xyz_mm.shape)
    columns = [np.degrees(t.q).round(2), np.degrees(t.q), nominal.round(1), t.xyz_mm]
    return {"log.csv": _written(header, columns, t, rng)}, ()


def _units_by_column(t: _Table, rng: np.random.Generator) -> _Files:
    """Write columns of which each states a unit of its own, in brackets or on a line of units."""
    angles, lengths = rng.choice(["deg", "rad"], 6), rng.choice(list(_TO), 3)
    angles[rng.choice(6, 2, replace=False)] = ["deg", "rad"]
    q = np.where(angles == "deg", np.degrees(t.q), t.q)
    xyz = t.xyz_mm * np.array([_TO[unit] for unit in lengths])
    names, units = [*(f"J{k}" for k in range(1, 7)), "X", "Y", "Z"], [*angles, *lengths]
    if rng.random() < 0.5:
        header = [f"{name} [{unit}]" for name, unit in zip(names, units, strict=True)]
        return {"units.csv": _written(header, [q, xyz], t, rng)}, ()
    body = text(rows(q, xyz), names).decode().split("\n", 1)
    return {"units.csv": f"{body[0]}\n{','.join(units)}\n{body[1]}".replace("nan", t.bad).encode()}, ()


PAIRS = (
    ("{}", "FARO {}"), ("{} Soll", "{} Ist"), ("{}_cmd", "{}_act"), ("robot.{}", "leica.{}"), ("tcp_{}", "tracker_{}"),
    ("{}1", "{}2"), ("P_{}", "M_{}"), ("controller_{}", "{}"), ("{}_ref", "{}_laser"), ("{}_actual", "{}"),
)  # fmt: skip
"""Names of a place that the controller computed, and of the same place as measured."""


def _controller_beside(t: _Table, rng: np.random.Generator) -> _Files:
    """Write the pose that the controller computed with its own constants next to the measured place."""
    own, tool_mm = none(), rng.choice([0.0, 1.0]) * rng.uniform([-50, -50, 50], [50, 50, 200]).round(1)
    own.offset[1:5], own.a[2:4] = np.radians(rng.normal(0, 0.05, 4)), rng.normal(0, 0.5, 2)
    R, p = flange(constants(t.arm), own, t.truth.q)
    frame = Rotation.from_euler("z", rng.choice([0.0, 0.0, 180.0, 37.0]), degrees=True)
    t.controller_mm = frame.apply(p + R @ tool_mm).round(int(rng.choice([2, 3, 4])))
    if t.truth.q.shape == t.q.shape and t.says == "posture":
        t.controller_mm = t.xyz_mm
    names = PAIRS[int(rng.integers(len(PAIRS)))]
    places = [
        ([name.format(axis) for axis in "XYZ"], xyz)
        for name, xyz in zip(names, (t.controller_mm, t.xyz_mm), strict=True)
    ]
    places = places[:: int(rng.choice([1, -1]))]
    header = [*(f"A{k}" for k in range(1, 7)), *places[0][0], *places[1][0]]
    return {"both.csv": _written(header, [np.degrees(t.q), places[0][1], places[1][1]], t, rng)}, ()


EXPORTERS: dict[str, Callable[[_Table, np.random.Generator], _Files]] = {
    "a spreadsheet": _spreadsheet, "pandas": _pandas, "no header": _headless, "two files, no header": _two_headless,
    "matrices": _matrices, "KUKA": _kuka, "FANUC": _fanuc, "ABB": _abb, "PlotJuggler": _plotjuggler,
    "rostopic": _rostopic, "RTDE beside a tracker": _rtde, "a report and joints": _analyzer,
    "a workbook": _decimal_comma_workbook, "motion capture": _motion_capture, "commanded beside": _commanded_too,
}  # fmt: skip

NEW_EXPORTERS = {"units by column": _units_by_column, "a controller beside": _controller_beside}
"""Formats that `drawn` adds on request."""


# -- Generation and evaluation. --


def drawn(seed: int, *, new: bool = False) -> Drawn:
    """Table for a seed; every fifteenth is a path. new: choose from the added defects and formats too."""
    rng = np.random.default_rng([87 if new else 54, seed])
    if seed % 15 == 14 and not new:
        return _path(rng)
    arm = str(rng.choice(ARMS))
    truth = seen_by_tracker(arm, int(rng.choice([25, 40, 60, 120])), rng)
    table = _Table(arm, truth.q, truth.xyz_mm, truth.turn, truth)
    troubles = NEW_TROUBLES if new else TROUBLES
    weights = np.array([weight for _, weight in troubles.values()])
    trouble = str(rng.choice(list(troubles), p=weights / weights.sum()))
    troubles[trouble][0](table, rng)
    exporters = {**EXPORTERS, **NEW_EXPORTERS} if new else EXPORTERS
    is_new = new and (trouble == "sound" or rng.random() < 0.5)
    exporter = str(rng.choice(list(NEW_EXPORTERS if is_new else exporters)))
    files, options = exporters[exporter](table, rng)
    truth = replace(truth, xyz_mm=truth.xyz_mm if trouble == "a left-handed frame" else table.xyz_mm)
    return Drawn(
        table.arm, exporter, trouble, files, truth, table.says, table.sound, options, answer=table.answer,
        controller_mm=table.controller_mm,
    )  # fmt: skip


def _path(rng: np.random.Generator) -> Drawn:
    """A circle of a tracker at 1 kHz: with an outlier, with a repeated position, or correct."""
    t_s = np.arange(8000) / 1000
    angle = 2 * np.pi * 0.25 * t_s
    xyz = 150 * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle]) @ Rotation.random(rng=rng).as_matrix()
    xyz += np.array([1200.0, 300.0, 500.0]) + rng.normal(0, 0.01, xyz.shape)
    trouble, row, says = (
        str(rng.choice(["a sound path", "a spike", "a beam stood still"])),
        int(rng.integers(800, 7000)),
        "",
    )
    if trouble == "a spike":
        xyz[row : row + int(rng.choice([1, 2, 4]))] += rng.normal(0, 3.0, 3)
        says = "outlier"
    elif trouble == "a beam stood still":
        xyz[row : row + 300] = xyz[row]
        says = "repeat"
    nothing = Poses(np.zeros((len(xyz), 6)), xyz, Rotation.identity(len(xyz)))
    body = text(rows(t_s[:, None], xyz), ["t_s", "x_mm", "y_mm", "z_mm"])
    return Drawn("ur10e", "a path", trouble, {"path.csv": body}, nothing, says, test="path")


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
        is_new = drawn.trouble in NEW_TROUBLES and drawn.says
        return Judged(
            "refused", "" if not is_new or re.search(drawn.says, done.stderr) else "wrong reason", done.stderr
        )
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
        away_mm = float(np.abs(table.xyz_mm - drawn.truth.xyz_mm).max())
        if _turned(table.q, drawn.truth.q) > _LAST_DIGIT_RAD or (drawn.controller_mm is not None and away_mm > 1):
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
    if drawn.trouble == _TURNED:  # the joints equal those of the arm modulo a turn, and the rows are named
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
        "joints" * (_turned(table.q, drawn.truth.q) > _LAST_DIGIT_RAD),
        "places" * bool(np.abs(table.xyz_mm - drawn.truth.xyz_mm).max() > _LAST_DIGIT_MM),
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
