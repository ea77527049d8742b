"""Pose tables of instruments, controllers and public data sets: measured files, and simulated files in such formats.

Simulated positions come from independent kinematics with errors of a healthy arm, an unknown frame and tool, and
tracker noise. Each file has a description and the expected result of an import.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from analysis import load_run
from analysis.runs.tables import PoseTable, Table
from tests.support.command_line import ran
from tests.worlds.arms.independent_arm import constants_of, flange, healthy, none, postures

Array = NDArray[np.float64]
DATA = Path(__file__).parents[3] / "shared" / "data"
Outcome = Literal["without a word", "one question", "not"]
_POSES, _NOISE_MM, _NOISE_DEG = 40, 0.03, 0.01
_UR = ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint")
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
    files: dict[str, bytes | Path]
    rig: str = "ur10e"
    options: tuple[str, ...] = ()
    asks: tuple[str, ...] = ()
    truth: Poses | None = None

    @property
    def is_here(self) -> bool:
        """Whether the files exist on this computer."""
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


@cache
def poses() -> Poses:
    """Return poses of an arm in the middle of its joint ranges, enough to distinguish all interpretations."""
    return seen("ur10e", np.random.default_rng(5), _POSES, (60, 30, 30, 60, 50, 90))


def drawn(seed: int) -> tuple[str, Poses]:
    """A rig, and a random number of poses in a random part of the joint ranges, with some joints nearly
    constant.
    """
    rng = np.random.default_rng(seed)
    rig, count = str(rng.choice(["ur10e", "paper-fanuc"])), int(rng.choice([12, 15, 25, 60]))
    half_deg = rng.choice([0.02, 0.05, 0.1, 0.3, 1.0]) * np.array([60.0, 30, 30, 60, 50, 90])
    return rig, seen(rig, rng, count, tuple(half_deg * rng.choice([0.05, 1.0], 6, p=[0.3, 0.7])))


def seen(rig: str, rng: np.random.Generator, count: int, half_deg: tuple[float, ...]) -> Poses:
    """Simulate poses of an arm measured by a tracker with an unknown frame."""
    q = postures(rig, count, rng, half_deg)
    R, p = flange(constants_of(rig), healthy(rng), q)
    base, tool = Rotation.random(rng=rng), Rotation.random(rng=rng)
    place = p + R @ np.array([20.0, -35.0, 110.0]) + rng.normal(0, _NOISE_MM, p.shape)
    noise = Rotation.from_rotvec(rng.normal(0, np.radians(_NOISE_DEG), p.shape))
    return Poses(
        q, base.apply(place) + np.array([1800.0, -640.0, 310.0]), base * noise * Rotation.from_matrix(R) * tool
    )


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


def workbook(header: Sequence[str], values: Array) -> bytes:
    import openpyxl  # noqa: PLC0415 - slow to import

    book = openpyxl.Workbook()
    for row in (list(header), *values.tolist()):
        book.active.append(row)
    held = io.BytesIO()
    book.save(held)
    return held.getvalue()


def _kuka(p: Poses) -> bytes:
    abc = p.turn.as_euler("ZYX", degrees=True)
    header = [*(f"A{k}" for k in range(1, 7)), "X", "Y", "Z", "A", "B", "C"]
    return text(rows(np.degrees(p.q), p.xyz_mm, abc), header, ";", comma=True)


def _fanuc(p: Poses) -> bytes:
    header = ["X (mm)", "Y (mm)", "Z (mm)", "W (deg)", "P (deg)", "R (deg)", *(f"J{k} (deg)" for k in range(1, 7))]
    return text(rows(p.xyz_mm, p.turn.as_euler("xyz", degrees=True), np.degrees(p.q)), header)


def _abb(p: Poses) -> bytes:
    header = [*(f"rax_{k}" for k in range(1, 7)), "x", "y", "z", "q1", "q2", "q3", "q4"]
    return text(rows(np.degrees(p.q), p.xyz_mm, p.quat[:, [3, 0, 1, 2]]), header, "\t")


def _staubli(p: Poses) -> bytes:
    header = ["J1", "J2", "J3", "J4", "J5", "J6", "X", "Y", "Z", "RX", "RY", "RZ"]
    return text(rows(np.degrees(p.q), p.xyz_mm, p.turn.as_euler("XYZ", degrees=True)), header, " ")


def _rotvec(p: Poses) -> bytes:
    header = [*(f"target_q_{k}" for k in range(6)), *(f"actual_q_{k}" for k in range(6))]
    header += ["tracker_x", "tracker_y", "tracker_z", "tracker_rx", "tracker_ry", "tracker_rz"]
    return text(rows(p.q + 1e-5, p.q, p.xyz_mm / 1e3, p.turn.as_rotvec()), header)


def _leica(p: Poses) -> bytes:
    header = ["X  [mm]", "Y  [mm]", "Z  [mm]", "U(95)  [mm]", "U(95) X  [mm]", "U(95) Y  [mm]", "U(95) Z  [mm]"]
    header += ["Tilt  [deg]", "Q0 ", "Q1 ", "Q2 ", "Q3 ", "Image RMS  [µm]", "Target", "Time Stamp"]
    u, quat = np.full((len(p.q), 4), 0.004), p.quat[:, [3, 0, 1, 2]]
    cells = [
        [*xyz, *d, 29.9, *one, 0.22, "TMC 30-B #1", "'11.10.2022 15:06:48.043"]
        for xyz, d, one in zip(p.xyz_mm.tolist(), u.tolist(), quat.tolist(), strict=True)
    ]
    return text(cells, header)


def _tum(p: Poses) -> bytes:
    t = np.arange(len(p.q)) * 0.5
    return b"# ground truth trajectory\n# timestamp tx ty tz qx qy qz qw\n" + text(
        rows(t, p.xyz_mm / 1e3, p.quat), sep=" "
    )


def _timed_joints(p: Poses) -> bytes:
    cells = [[f"{t:.6f}", *row] for t, row in zip((np.arange(len(p.q)) * 0.5).tolist(), p.q.tolist(), strict=True)]
    return text(cells[::-1], ["timestamp", *(f"joint_{k}" for k in range(1, 7))])


def _camera(p: Poses) -> bytes:
    """Write the pose of a board measured by a camera on the tool."""
    turn = p.turn.inv()
    header = [*(f"joint{k}" for k in range(6)), "tvec_x", "tvec_y", "tvec_z", "rvec_x", "rvec_y", "rvec_z"]
    return text(rows(p.q, -turn.apply(p.xyz_mm) / 1e3, turn.as_rotvec()), header)


def _auto_id(p: Poses) -> bytes:
    cells = rows(p.xyz_mm, p.turn.as_euler("xyz", degrees=True), np.degrees(p.q))
    return text([[f"tag.{k}", *row] for k, row in enumerate(cells)], sep="\t")


def _matrices(p: Poses) -> bytes:
    T = np.tile(np.eye(4), (len(p.q), 1, 1))
    T[:, :3, :3], T[:, :3, 3] = p.turn.as_matrix(), p.xyz_mm / 1e3
    return text(rows(p.q, T.reshape(-1, 16)))


def _inches(p: Poses) -> bytes:
    head = b"// Point export\n// Operator: nobody\n"
    header = ["Point", "X", "Y", "Z", "J1", "J2", "J3", "J4", "J5", "J6"]
    units = ["", "in", "in", "in", "deg", "deg", "deg", "deg", "deg", "deg"]
    cells = [[f"p{k}", *row] for k, row in enumerate(rows(p.xyz_mm / 25.4, np.degrees(p.q)))]
    return head + text(cells, header).replace(b"\n", b"\n" + ",".join(units).encode() + b"\n", 1)


def _nist(p: Poses) -> bytes:
    """Write the columns of NIST's degradation measurement of a UR5, reported by the robot itself."""
    header = [f"ROBOT_ACTUAL_JOINT_POSITIONS (J{k})" for k in range(1, 7)]
    header += [f"ROBOT_ACTUAL_JOINT_VELOCITIES (J{k})" for k in range(1, 7)]
    header += [f"ROBOT_CARTESIAN_COORD_TOOL ({axis})" for axis in ("x", "y", "z", "rx", "ry", "rz")]
    return text(rows(p.q, 0 * p.q, p.xyz_mm / 1e3, p.turn.as_rotvec()), header)


def _pairs(p: Poses) -> bytes:
    """Write hand-eye pairs without joints: poses of the flange and of a camera."""
    header = [f"{who}_{what}" for who in ("robot", "optical") for what in ("x", "y", "z", "qx", "qy", "qz", "qw")]
    return text(rows(p.xyz_mm / 1e3, p.quat, p.xyz_mm / 1e3, p.quat), header)


def _three_targets(p: Poses) -> bytes:
    """Write three reflectors per pose and nine joint columns, without a header."""
    there = [p.xyz_mm + p.turn.apply(np.array(place)) for place in ((0, 0, 0), (100.0, 0, 0), (0, 100.0, 0))]
    return text(rows(*there, np.zeros((len(p.q), 6)), np.degrees(p.q)), sep=" ")


def _residuals(p: Poses) -> bytes:
    target = p.xyz_mm.round(1)
    header = ["x_t", "y_t", "z_t", "x_dif", "y_dif", "z_dif", *(f"joint_{k}" for k in range(1, 7))]
    return text(rows(target, target - p.xyz_mm, np.degrees(p.q)), header)


def _ipa(p: Poses) -> bytes:
    header = ["Timestamp", "Goal x", "Goal y", "Goal z", *_UR, "measurement_temperature"]
    header += [f"measurement_{one}" for axis in "xyz" for one in (axis, f"std_{axis}")] + [
        f"measurement_r{axis}" for axis in "xyz"
    ]
    spread = np.stack([p.xyz_mm, np.full_like(p.xyz_mm, 0.01)], axis=2).reshape(-1, 6)
    stamp = np.full((len(p.q), 1), 2.02e13)
    return text(
        rows(stamp, p.xyz_mm * 1e-3 + 0.2, p.q, stamp * 0 + 21.5, spread, p.turn.as_euler("XYZ", degrees=True)),
        header,
        ";",
        comma=True,
    )


_ALPHABET = [2, 1, 0, 3, 4, 5]
"""Joints of a Universal Robots arm in alphabetical order, as published by drivers."""


def _plotjuggler(p: Poses) -> bytes:
    """Write a PlotJuggler export: a column per field, joints by name."""
    names = [_UR[k] for k in _ALPHABET]
    kinds = ("position", "velocity", "effort")
    header = [f"/joint_states/{name}/{kind}" for kind in kinds for name in names]
    rng = np.random.default_rng(1)
    values = [p.q[:, _ALPHABET], rng.normal(0, 1e-4, p.q.shape), rng.normal(0, 5, p.q.shape), p.xyz_mm / 1e3]
    return text(rows(*values), [*header, "/leica/point/x", "/leica/point/y", "/leica/point/z"])


def _rostopic(p: Poses, named: bool = True) -> bytes:
    """Write the output of `rostopic echo -p` for a JointState, with tracker positions added."""
    names = [f"field.name{k}" for k in range(6)] if named else []
    header = ["%time", *names, *(f"field.position{k}" for k in range(6)), "x", "y", "z"]
    order = [_UR[k] for k in _ALPHABET] if named else []
    lines = [
        [1_700_000_000_000_000_000 + 5_000_000_000 * k, *order, *q[_ALPHABET], *xyz]
        for k, (q, xyz) in enumerate(zip(p.q, p.xyz_mm, strict=True))
    ]
    return text(lines, header)


def _last_column(p: Poses) -> bytes:
    """Write 21 columns with currents and temperatures, joint 6 last."""
    rng = np.random.default_rng(2)
    header = ["Nr", "Temp1", "Temp2", "X", "Y", "Z", "A", "B", "C", *(f"I{k}" for k in range(1, 7))]
    turns = p.turn.as_euler("ZYX", degrees=True)
    more = [
        np.arange(len(p.q))[:, None],
        rng.normal(22, 0.1, (len(p.q), 2)),
        p.xyz_mm,
        turns,
        rng.normal(0, 2, p.q.shape),
    ]
    return text(rows(*more, np.degrees(p.q)), [*header, *(f"J{k}" for k in range(1, 7))])


def _mirrored(p: Poses) -> bytes:
    return text(rows(np.degrees(p.q), p.xyz_mm * [1, -1, 1]), [*(f"q{k}" for k in range(1, 7)), "x", "y", "z"])


def _backwards(p: Poses) -> bytes:
    signs = np.array([1, 1, 1, 1, -1, 1])
    return text(rows(np.degrees(p.q) * signs, p.xyz_mm), [*(f"q{k}" for k in range(1, 7)), "x", "y", "z"])


def _comma_cells(p: Poses) -> bytes:
    """Write a workbook with text cells that contain decimal commas."""
    import openpyxl  # noqa: PLC0415 - an extra

    book = openpyxl.Workbook()
    book.active.append([*(f"q{k}" for k in range(1, 7)), "x", "y", "z"])
    for row in rows(np.degrees(p.q), p.xyz_mm):
        book.active.append([f"{value:.6f}".replace(".", ",") for value in row])
    data = io.BytesIO()
    book.save(data)
    return data.getvalue()


def _computed(p: Poses, rig: str) -> bytes:
    """Write flange positions computed by the controller from its own constants."""
    own = none()
    own.offset[1:4], own.a[2] = np.radians([0.05, -0.08, 0.03]), 0.8
    _, places = flange(constants_of(rig), own, p.q)
    return text(rows(np.degrees(p.q), places), [*(f"q{k}" for k in range(1, 7)), "x", "y", "z"])


def foreign_tables() -> list[Foreign]:
    """All tables: measured ones first, then simulated ones."""
    return [*_measured(), *in_format(poses())]


def _measured() -> list[Foreign]:
    ipa, jacobi = DATA / "ipa-ur10", DATA / "jacobi"
    sign = ("residual",)

    def one(name: str, words: str, outcome: Outcome, path: Path, rig: str, asks: tuple[str, ...] = ()) -> Foreign:
        return Foreign(name, words, True, outcome, {path.name: path}, rig, asks=asks)

    return [
        one("ipa-b", "Fraunhofer IPA, UR10, series B: Leica T-Mac", "without a word", ipa / "series_b.csv", "ur10"),
        one("ipa-d", "Fraunhofer IPA, UR10, series D", "without a word", ipa / "series_d.csv", "ur10"),
        one("ur5-grid", "Jacobi, UR5, grid: target and residual", "one question", jacobi / "ur5_grid.csv", "ur5", sign),
        one("ur5-random", "Jacobi, UR5, 20 random poses", "one question", jacobi / "ur5_random.csv", "ur5", sign),
        one("wam-grid", "Jacobi, Barrett WAM: seven joints, for a rig of six", "not", jacobi / "wam_grid.csv", "ur10e"),
        one("mukca", "MUKCa, Panda: joints alone", "not", DATA / "mukca" / "panda_1_front_hole_0.csv", "ur10e"),
    ]


def in_format(p: Poses, rig: str = "ur10e") -> list[Foreign]:
    def one(
        name: str,
        words: str,
        write: Callable[[Poses], bytes],
        outcome: Outcome = "without a word",
        asks: tuple[str, ...] = (),
    ) -> Foreign:
        return Foreign(name, words, False, outcome, {f"{name}.csv": write(p)}, rig=rig, asks=asks, truth=p)

    angles = [f"q{k}" for k in range(1, 7)]
    joints, tracker = (
        text(rows(np.degrees(p.q)), angles),
        text(rows(p.xyz_mm, p.turn.as_euler("xyz", degrees=True)), ["x", "y", "z", "rx", "ry", "rz"]),
    )
    headless = {"j.csv": text(rows(np.degrees(p.q))), "p.csv": text(rows(p.xyz_mm))}
    by_row, by_time = ("--join", "rows"), ("--join", "timestamp")
    leica = {"Leica.csv": _leica(p), "theta.xlsx": workbook([f"theta{k}" for k in range(1, 7)], np.degrees(p.q))}
    return [
        one("ipa-like", "IPA's columns, decimal commas", _ipa),
        one("jacobi-like", "Jacobi's columns: target and residual", _residuals, "one question", ("residual",)),
        one("kuka", "A1 … A6, X, Y, Z, A, B, C; decimal commas", _kuka),
        one("fanuc", "X, Y, Z, W, P, R, J1 … J6, units in the header", _fanuc),
        one("abb", "rax_1 … rax_6, x, y, z, q1 … q4, tabs", _abb),
        one("staubli", "J1 … J6, X, Y, Z, RX, RY, RZ, blanks", _staubli),
        one("rtde", "target_q and actual_q of RTDE beside a tracker's rotation vectors, m", _rotvec),
        one("auto-id", "DELMIA's Auto ID: tag, place, roll-pitch-yaw, joints; no header", _auto_id),
        one("matrices", "joints and 4 × 4 matrices in m; no header", _matrices),
        one("inches", "a tracker's points in inches, comments, a line of units", _inches),
        one("camera", "a camera on the tool: joints, tvec, rvec of a board", _camera),
        one("nist", "NIST's UR5: joints, and the pose that the robot computes", _nist, "one question", ("place",)),
        *(
            [
                one("plotjuggler", "PlotJuggler: joints by name in the order of the alphabet", _plotjuggler),
                one("rostopic", "rostopic echo -p: names beside positions", _rostopic),
                one(
                    "unnamed",
                    "rostopic echo -p without the names",
                    lambda p: _rostopic(p, False),
                    "one question",
                    ("joints",),
                ),
            ]
            if rig == "ur10e"
            else []
        ),
        one("last", "21 columns of which the last is joint 6", _last_column),
        one("mirrored", "a left-handed frame", _mirrored, "one question", ("place",)),
        one("backwards", "joint 5 counting the other way", _backwards, "one question", ("joints",)),
        one("computed", "places that the controller computed", lambda p: _computed(p, rig), "not"),
        Foreign(
            "headless",
            "joints in one file, places in another, neither with a header",
            False,
            "without a word",
            headless,
            rig=rig,
            options=by_row,
            truth=p,
        ),
        Foreign(
            "commas",
            "a workbook whose cells are text with decimal commas",
            False,
            "without a word",
            {"t.xlsx": _comma_cells(p)},
            rig=rig,
            truth=p,
        ),
        one("pairs", "hand-eye pairs without joints", _pairs, "not"),
        one("three", "three reflectors a pose and nine joints; no header", _three_targets, "one question", ("place",)),
        Foreign(
            "leica",
            "ASTL: a Leica export, and a workbook of joints",
            False,
            "without a word",
            leica,
            options=by_row,
            truth=p,
        ),
        Foreign(
            "two-files",
            "joints in one file, the tracker's pose in another",
            False,
            "without a word",
            {"joints.csv": joints, "laser.csv": tracker},
            options=by_row,
            truth=p,
        ),
        Foreign(
            "tum",
            "a TUM trajectory, and joints joined by time",
            False,
            "without a word",
            {"track.txt": _tum(p), "joints.csv": _timed_joints(p)},
            options=by_time,
            truth=p,
        ),
    ]
