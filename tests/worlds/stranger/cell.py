"""A cell as described in its rig file, parsed from YAML by hand; lengths in mm, angles in rad. Effects are ignored."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from tests.worlds.stranger.screws import Arm, Array, Constants, arm_from, placed

RIGS = Path(__file__).parents[3] / "rigs"
ROBOTS = ("paper-fanuc", "ur10e-cell")


@dataclass(frozen=True)
class Place:
    """Position of a circle or a hemisphere. centre, u, v, n (3,), v = n × u; radius in mm; posture (6,) rad near phi
    = 0 or near the pole; speed in mm/s and lead-in in rad of a circle.
    """

    centre: Array
    u: Array
    v: Array
    n: Array
    radius: float
    posture: Array
    speed: float = 25.0
    lead: float = 0.0
    start: float = 0.0


@dataclass(frozen=True)
class Cell:
    """A cell: arm; constants for modifying it; limits (6, 2) rad, speeds (6,) rad/s; gauge_at (2,) mm along the
    baseline.
    """

    data: dict[str, Any]
    constants: Constants
    arm: Arm
    limits: Array
    speeds: Array
    circle: Place
    hemisphere: Place
    gauge_at: Array


def read_cell(robot: str) -> Cell:
    """A shipped rig without the hidden effects and the eccentricity of its emulated cell."""
    data = yaml.safe_load((RIGS / f"{robot}.yaml").read_text(encoding="utf-8"))
    data["effects"] = []
    data["tests"]["circle"].pop("eccentricity_mm", None)
    return cell_of(data)


def cell_of(data: dict[str, Any]) -> Cell:
    """Cell of a parsed rig file."""
    axes = data["robot"]["axes"]
    constants = _constants(data["robot"])
    return Cell(
        data=data,
        constants=constants,
        arm=arm_from(constants),
        limits=np.radians([axis["limits_deg"] for axis in axes]),
        speeds=np.radians([axis["speed_deg_s"] for axis in axes]),
        circle=_place(data["tests"]["circle"]),
        hemisphere=_place(data["tests"]["hemisphere"]),
        gauge_at=np.array([float(data["gauges"][name]["offset_mm"]) for name in ("g1", "g2")]),
    )


def moved(cell: Cell, circle: Place) -> Cell:
    """Cell with a circle at a different place or of a different radius, also changed in its rig file."""
    tests = dict(cell.data["tests"])
    tests["circle"] = tests["circle"] | {
        "centre_mm": [round(float(x), 3) for x in circle.centre],
        "radius_mm": circle.radius,
        "posture_deg": [round(float(x), 1) for x in np.degrees(circle.posture)],
    }
    return replace(cell, circle=circle, data=cell.data | {"tests": tests})


def _constants(robot: dict[str, Any]) -> Constants:
    axes = robot["axes"]

    def column(key: str) -> Array:
        return np.array([float(axis.get(key, 0.0)) for axis in axes])

    return Constants(
        a=column("a_mm"),
        alpha=np.radians(column("alpha_deg")),
        beta=np.radians(column("beta_deg")),
        d=column("d_mm"),
        zero=np.radians(column("offset_deg")),
        coupling=np.array(robot.get("coupling", np.eye(6)), dtype=float),
        base=_pose(robot.get("base", {})),
        tool=_pose(robot.get("tool", {})),
        mass=column("mass_kg"),
        centre=np.array([axis.get("centre_mm", (0.0, 0.0, 0.0)) for axis in axes], dtype=float),
        payload=float(robot.get("payload_kg", 0.0)),
    )


def _pose(pose: dict[str, Any]) -> Array:
    """Pose (4, 4) of a position and rotations about the fixed x, then y, then z axis."""
    rx, ry, rz = np.radians(pose.get("rpy_deg", (0.0,) * 3))
    T = placed(2, rz) @ placed(1, ry) @ placed(0, rx)
    T[:3, 3] = pose.get("xyz_mm", (0.0,) * 3)
    return T


def _place(test: dict[str, Any]) -> Place:
    n = np.array(test.get("normal", (0.0, 0.0, 1.0)), dtype=float)
    n /= np.linalg.norm(n)
    zero = np.array(test.get("zero", (1.0, 0.0, 0.0)), dtype=float)
    u = np.cross(np.cross(n, zero), n)
    u /= np.linalg.norm(u)
    return Place(
        centre=np.array(test["centre_mm"], dtype=float),
        u=u,
        v=np.cross(n, u),
        n=n,
        radius=float(test["radius_mm"]),
        posture=np.radians(test["posture_deg"]),
        speed=float(test.get("speed_mm_s", 25.0)),
        lead=float(np.radians(test.get("lead_deg", 0.0))),
        start=float(np.radians(test.get("start_deg", 0.0))),
    )
