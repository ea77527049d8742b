"""Delivered Universal Robots arms: the factory constants of `../shared/data/ur-factory`, with poses and circles.

An arm is the six frames of the ROS driver, multiplied as they stand. The circles are those of `tests.worlds.stranger`,
with the screws of the real arm. The robot drives to the joint angles of the data sheet.
"""

from __future__ import annotations

import csv
from collections import defaultdict
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from tests.worlds.stranger.cell import RIGS, Cell, cell_of
from tests.worlds.stranger.faults import Fault
from tests.worlds.stranger.gauges import Link
from tests.worlds.stranger.measure import read, tool_of, trace_of
from tests.worlds.stranger.motion import lap, targets, track_of, visits
from tests.worlds.stranger.noise import Noise, added, stamps
from tests.worlds.stranger.screws import Arm, Array, pose
from tests.worlds.stranger.tables import write_table

DATA = Path(__file__).parents[3] / "shared" / "data" / "ur-factory" / "arms.csv"
CIRCLE_DEG = (2.0, -75.3, 101.4, 55.2, 84.6, 107.8)
HEMISPHERE_DEG = (3.0, -86.0, 115.0, -28.0, 93.0, -90.0)
_HEMISPHERE = 0.3
"""Radius of the hemisphere as a share of the two long links."""
_TOOL = {"xyz_mm": [0, 0, 150], "rpy_deg": [0, 90, 0]}
_LOW_DEG = np.array([-150, -130, 30, -150, -120, -170], dtype=float)
_HIGH_DEG = np.array([150, -30, 130, 150, 120, 170], dtype=float)


@dataclass(frozen=True)
class FactoryArm:
    """A delivered arm. rows: the frames by name as in the YAML of the ROS package, in m and rad.

    counted (6,) rad: reading of its controller less the reading of a controller that counts as the data sheet does.
    Arm 9 counts elbow and wrist 1 from half a turn.
    """

    number: int
    model: str
    rows: dict[str, dict[str, float]]
    counted: Array

    @property
    def frames(self) -> Array:
        """The frames (6, 4, 4) mm at reading 0, each relative to the one before."""
        frames = np.tile(np.eye(4), (6, 1, 1))
        for frame, row in zip(frames, self.rows.values(), strict=True):
            frame[:3, :3] = Rotation.from_euler("xyz", [row["roll"], row["pitch"], row["yaw"]]).as_matrix()
            frame[:3, 3] = 1e3 * np.array([row["x"], row["y"], row["z"]])
        return frames

    def flange(self, q: Array) -> Array:
        """Flange poses (n, 4, 4) mm at angles q (n, 6) rad, counted as in the data sheet."""
        T = np.tile(np.eye(4), (len(q), 1, 1))
        for frame, angle in zip(self.frames, (q + self.counted).T, strict=True):
            turn = np.tile(np.eye(4), (len(q), 1, 1))
            turn[:, :3, :3] = Rotation.from_euler("z", angle[:, None]).as_matrix()
            T = T @ frame @ turn
        return T

    def write_yaml(self, path: Path) -> None:
        """Write my_robot_calibration.yaml of the ROS package ur_calibration."""
        path.write_text(yaml.safe_dump({"kinematics": self.rows | {"hash": f"calib_{self.number}"}}, sort_keys=False))


def arms() -> list[FactoryArm]:
    """Read the delivered arms; empty if the data are absent."""
    if not DATA.is_file():
        return []
    rows: dict[int, dict[str, dict[str, float]]] = defaultdict(dict)
    models = {}
    units = {"x": "m", "y": "m", "z": "m", "roll": "rad", "pitch": "rad", "yaw": "rad"}
    with DATA.open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            number = int(row["arm"])
            models[number] = row["model"]
            rows[number][row["frame"]] = {key: float(row[f"{key}_{unit}"]) for key, unit in units.items()}
    return [FactoryArm(k, models[k], rows[k], np.pi * np.array([0, 0, k == 9, k == 9, 0, 0])) for k in rows]


def write_poses(
    arm: FactoryArm, path: Path, count: int, rng: np.random.Generator, *, zero_deg: Array, raw: bool, noise_mm: float
) -> None:
    """Write a table of tracker poses. zero_deg (6,): errors of the zeros. raw: readings as this controller counts."""
    q = np.radians(rng.uniform(_LOW_DEG, _HIGH_DEG, (count, 6)))
    T = arm.flange(q + np.radians(zero_deg))
    tool, turn = (
        rng.uniform([-60, -60, 80], [60, 60, 200]),
        Rotation.from_euler("z", rng.uniform(-180, 180), degrees=True),
    )
    xyz = turn.apply(T[:, :3, 3] + T[:, :3, :3] @ tool) + rng.uniform(-3000, 3000, 3)
    xyz += rng.normal(0, noise_mm / np.sqrt(3), xyz.shape)
    head = ",".join([*(f"q{k}_deg" for k in range(1, 7)), "x_mm", "y_mm", "z_mm"])
    table = np.hstack([np.degrees(q + raw * arm.counted), xyz])
    np.savetxt(path, table, fmt="%.5f", delimiter=",", header=head, comments="")


def cell_for(arm: FactoryArm) -> Cell:
    """A cell of the data sheet with a circle and a hemisphere at the same postures for every model."""
    data: dict[str, Any] = yaml.safe_load((RIGS / "ur10e.yaml").read_text(encoding="utf-8"))
    library = yaml.safe_load((RIGS / "arms" / f"{arm.model}.yaml").read_text(encoding="utf-8"))
    data |= {"name": arm.model, "robot": library["robot"] | {"tool": _TOOL, "payload_kg": 2}, "effects": []}
    data["tests"].pop("repeatability", None)
    data["tests"]["circle"].pop("eccentricity_mm", None)
    links = sum(abs(axis.get("a_mm", 0.0)) for axis in library["robot"]["axes"])
    data["tests"]["hemisphere"]["radius_mm"] = round(_HEMISPHERE * links)
    nominal = cell_of(data).arm
    for test, posture in (("circle", CIRCLE_DEG), ("hemisphere", HEMISPHERE_DEG)):
        here = pose(nominal, np.radians([posture]))
        x, z = here.R[0, :, 0], here.R[0, :, 2]
        normal, zero, out = (x, -z, -z) if test == "circle" else (-z, x, -z)
        place = data["tests"][test]
        centre = here.p[0] - place["radius_mm"] * out
        place |= {"centre_mm": centre.tolist(), "normal": normal.tolist(), "zero": zero.tolist()}
        place |= {"posture_deg": list(posture)}
    return cell_of(data)


def write_circles(
    arm: FactoryArm, cell: Cell, directory: Path, rng: np.random.Generator, faults: list[Fault], *, repeats: int = 2
) -> list[tuple[str, Path]]:
    """Write tables of yaw, roll and radial runs of the real arm, and return test and path of each."""
    real, noise = replace(cell, arm=_screws(arm, cell.arm, cell.constants.tool)), Noise(white=0.001)
    track, written = track_of(cell, cell.circle), []
    runs = [(test, sense) for test in ("yaw", "roll") for _ in range(repeats) for sense in (1, -1)] + [("radial", 0)]
    balls = {test: rng.uniform(-0.5, 0.5, 3) for test in ("yaw", "roll", "radial")}
    at = targets(cell)
    for k, (test, sense) in enumerate(runs):
        place = cell.circle if sense else cell.hemisphere
        if sense:
            motion = lap(cell, track, test, sense, stamps(noise, 60.0, rng))
        else:
            order = np.arange(len(at["q"]))
            motion = visits(cell, at, order, rng.uniform(1.5, 3.0, len(order)))
        ball = place.centre + balls[test] + noise.ball_mm * rng.standard_normal(3)
        link = Link(ball, np.zeros(2 if sense else 1), cell.gauge_at)
        scatter = np.radians(noise.joints_deg) * rng.standard_normal(6)
        g = read(motion, faults, link, tool_of(real, motion, faults, trace_of(cell, motion), scatter))
        g = g + added(noise, motion.t[motion.rows], g.shape[1], rng)
        path = directory / f"{k:02d}-{test}.csv"
        write_table(path, motion, g, noise.encoder_deg)
        written.append((test, path))
    return written


def _screws(arm: FactoryArm, nominal: Arm, tool: Array) -> Arm:
    """Screws of the real arm; masses and their centres are those of the data sheet."""
    T, point, axis = np.eye(4), [], []
    for frame in arm.frames:
        T = T @ frame
        point.append(T[:3, 3])
        axis.append(T[:3, 2])
    return replace(nominal, point=np.array(point), axis=np.array(axis), tool=T @ tool, zero=arm.counted)
