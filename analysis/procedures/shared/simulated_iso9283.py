"""Simulated tracker recordings of the poses and paths of ISO 9283, for the arm of a rig with its effects.

The robot stops with realistic scatter; the tracker adds noise and has a random position, unless given in the rig file.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analysis.procedures.shared.simulated_touches import STOPS_MM
from analysis.robot.geometry.iso_cube import (
    STANDSTILL_S,
    CommandPath,
    Cube,
    Polygon,
    cube_of,
    cycle_stops,
    in_order,
    iso9283_of,
    joints_along,
)
from analysis.robot.kinematics.arm import Arm, Array, arm_of, transform
from analysis.robot.model.motion import Motion
from analysis.robot.model.predict import Model, Path, model_of, moved, stops
from analysis.runs.noise.cell_noise import TRACKER_MM
from rigs.effects import Effect
from rigs.errors import RigPlace
from rigs.rig import Rig

_FAR_MM = 3000.0
"""Distance of the tracker from the base."""
_RATE_HZ = 100.0
"""Positions per second; trackers record ten times as many, without more information about a simulated arm."""
_ACCELERATION_MM_S2 = 200.0
"""Acceleration of the programs (analysis/apps/makers/motion_plan.py)."""
_STEPS = 2000
"""Steps along each path with linear joint interpolation: on the circles the deviation is below 1 µm."""


def simulated_cube(rig: Rig, seed: int | None, effects: Sequence[Effect] | None = None) -> tuple[Array, Array, Array]:
    """Simulate tracker measurements of the cube poses.

    Returns joints (n, 6) rad, positions (n, 3) mm in the tracker frame, and the previous joints (n, 6) rad. seed: None
    for no noise. effects: in place of those of the rig file. Raises FileError if the cube does not fit into the work
    space.
    """
    q, rng = cycle_stops(rig), np.random.default_rng(seed or 0)
    noise = 0.0 if seed is None else float(np.hypot(TRACKER_MM, STOPS_MM))
    from_start = np.concatenate([cube_of(rig).q[:1], q])
    places = tool_places(model_of(rig, effects), from_start)[1:] + noise * rng.standard_normal((len(q), 3))
    return q, seen_by_tracker(rig, places, rng), from_start[:-1]


def simulated_path(rig: Rig, seed: int | None, effects: Sequence[Effect] | None = None) -> tuple[Array, Array]:
    """Simulate a tracker recording of the program that drives the paths at full speed. See `simulated_cube`.

    Returns times (n,) s and positions (n, 3) mm.
    """
    rng = np.random.default_rng(seed or 0)
    test, cube, arm = iso9283_of(rig), cube_of(rig), arm_of(rig.robot)
    where, legs = RigPlace.of(rig.name, "tests.iso9283"), dict[str, Array]()
    parts = list[Array]()
    for path in in_order(cube, test.path_cycles):
        if path.name == "way" or path.name not in legs:
            legs[path.name] = _leg(arm, cube, path, test.path_speed_mm_s, where)
        parts.append(legs[path.name])
    parts.insert(0, np.tile(parts[0][:1], (int(STANDSTILL_S * _RATE_HZ), 1)))
    q = np.concatenate(parts)
    t_s = np.arange(len(q)) / _RATE_HZ
    # Index of the present path including the standstill after it; 0 is the standstill before the first.
    leg = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    model = model_of(rig, effects)
    places = moved(model, Path(Motion(t_s, q), np.arange(len(q)))).T[:, :3, 3]
    if seed is not None:
        places = places + STOPS_MM * rng.standard_normal((len(parts), 3))[leg]
        places = places + TRACKER_MM * rng.standard_normal((len(q), 3))
    return t_s, seen_by_tracker(rig, places, rng)


def _leg(arm: Arm, cube: Cube, path: CommandPath, speed_mm_s: float, where: str) -> Array:
    """Joints (n, 6) rad along a path from rest to rest, with the standstill after it."""
    s = np.linspace(0.0, path.length_mm, _STEPS)
    s = np.unique(np.concatenate([s, path.arc_length_mm])) if isinstance(path, Polygon) else s
    q = joints_along(arm, cube, path, s, where)
    ramp_s = min(speed_mm_s / _ACCELERATION_MM_S2, float(np.sqrt(path.length_mm / _ACCELERATION_MM_S2)))
    whole_s = path.length_mm / (_ACCELERATION_MM_S2 * ramp_s) + ramp_s
    t = np.arange(0.0, whole_s + STANDSTILL_S, 1 / _RATE_HZ)
    speed = _ACCELERATION_MM_S2 * np.clip(np.minimum(t, whole_s - t), 0.0, ramp_s)
    driven = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2) / _RATE_HZ])
    driven = np.clip(driven * path.length_mm / driven[-1], 0.0, path.length_mm)
    return np.stack([np.interp(driven, s, column) for column in q.T], axis=1)


def tool_places(model: Model, q: Array) -> Array:
    """Tool positions (n, 3) mm in the world at joints q (n, 6) rad in sequence."""
    path = stops(q)
    return np.asarray(moved(model, path).T[path.rows, :3, 3])


def seen_by_tracker(rig: Rig, places_mm: Array, rng: np.random.Generator) -> Array:
    """Positions (n, 3) mm of the world in the frame of the tracker, from the rig file or random."""
    instrument = iso9283_of(rig).instrument
    if instrument is not None:
        T = transform(instrument)
    else:
        turn = rng.uniform(0, 2 * np.pi)
        T = np.eye(4)
        T[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
        T[:3, 3] = [_FAR_MM * np.cos(turn), _FAR_MM * np.sin(turn), rng.uniform(500.0, 1500.0)]
    return np.asarray((places_mm - T[:3, 3]) @ T[:3, :3])
