"""Simulate measurements: a program driven by a robot with effects, read with noise, as tables and as runs.

Gauges have the noise of a good cell: white noise of each reading, a slow wander of tool and link, and a small scatter
of every joint and the ball between runs. A tracker adds noise and has a random position, unless given in the rig file.
A rig file contains no socket positions, because users choose them; they are placed within reach, around the base, where
the arm has many postures.
"""

from __future__ import annotations

import hashlib
import pathlib
from collections.abc import Sequence
from dataclasses import replace
from itertools import accumulate, islice

import numpy as np

from analysis.procedures.shared.test_kind import Noise, Simulation, kind_of, path_of, predict
from analysis.robot.geometry.driven_programs import ACCELERATION_MM_S2
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
from analysis.robot.geometry.pose_setup import moved_by
from analysis.robot.kinematics.arm import Arm, Array, arm_of, forward, forward_and_jacobian, transform
from analysis.robot.kinematics.joint_limits import wrapped
from analysis.robot.predict import Model, Motion, Path, SetUp, model_of, moved, stops, visits
from analysis.runs.loading import SIMULATED, Measured, measured_of, rig_of
from analysis.runs.noise.cell_noise import SEAT_MM, TRACKER_MM
from analysis.runs.tables import GaugeTable, Table, TouchTable, columns_of
from daq.store import table_run
from rigs.effects import Effect, turned
from rigs.errors import FileError, RigPlace
from rigs.readiness import require_part, require_test
from rigs.rig import Rig
from rigs.schema.declared_tests import Touch
from rigs.schema.vocabulary import Direction, TestName

_DWELL_S = 4.0
"""Time between targets."""


def read_by_gauges(rig: Rig, program: GaugeTable, setup: SetUp, run: Simulation) -> Array:
    """Readings (n, k) mm along a program, given as a table without readings."""
    model = model_of(rig, run.effects)
    if run.seed is None:
        return predict(model, program, path_of(model, program), setup)
    noise = run.noise or Noise()
    rng = np.random.default_rng(run.seed)
    # Joints and ball displaced slightly, differently in each run.
    off = rng.normal(0.0, noise.scatter_deg, 6)
    scatter = tuple(turned(axis, float(deg)) for axis, deg in enumerate(off, start=1))
    ball = setup.ball + rng.normal(0.0, noise.scatter_mm, 3)
    model, setup = replace(model, effects=(*model.effects, *scatter)), replace(setup, ball=ball)
    values = predict(model, program, path_of(model, program), setup)
    white = np.array([gauge.accuracy_mm for _, gauge in rig.gauges])[: values.shape[1]]
    values = values + rng.normal(0.0, 1.0, values.shape) * white
    # Correlated noise (m,) mm common to all gauges, an Ornstein-Uhlenbeck process.
    kept = np.exp(-np.diff(program.t_s, prepend=program.t_s[0] - 1e9) / noise.wander_s)
    kicks = rng.normal(0.0, noise.wander_mm, len(program.t_s)) * np.sqrt(1 - kept**2)
    steps = zip(kept.tolist(), kicks.tolist(), strict=True)
    levels = accumulate(steps, lambda level, step: step[0] * level + step[1], initial=0.0)
    wandering = np.fromiter(islice(levels, 1, None), dtype=float, count=len(program.t_s))
    return np.asarray(values + wandering[:, None])


def visit_times(count: int) -> Array:
    return np.linspace(0.0, _DWELL_S * (count - 1), count)


STOPS_MM = 0.02
"""Scatter of a coordinate for a guided arm at rest: half of that of programmed stops."""
_APPROACH_RAD = (0.1, 0.4)
"""Joint motion before a touch, in one direction: the user swings elbow or wrist to the next posture."""
_POSTURES, _TRIES, _STEPS, _LARGEST_RAD = 300, 20, 25, 0.3
"""Number of postures tried together, number of attempts, number of steps to the socket, and largest joint step."""
_THERE_MM = 1e-6
_OFF_LIMIT = 0.05
"""Margin to the joint limits, relative to the range."""
_REACHED = (0.35, 0.7)
"""Socket distances relative to the reach: close to the base and at the end of the reach there are few postures."""


def touch_of(rig: Rig) -> Touch:
    return require_part(rig, rig.tests.touch, "touch")


def planned_touches(rig: Rig, seed: int = 0) -> TouchTable:
    """Touches of the nominal arm, distributed over the sockets. Raises FileError without a touch test, or postures."""
    return _standing(rig, _planned(rig, np.random.default_rng(seed))[0])


def simulated_touches(rig: Rig, seed: int | None, effects: Sequence[Effect] | None = None) -> TouchTable:
    """Simulate touches by an arm with these effects instead of the rig file's; seed: None for no scatter."""
    rng = np.random.default_rng(seed or 0)
    table, sockets = _planned(rig, rng)
    model = model_of(rig, effects)
    scatter = 0.0 if seed is None else float(np.hypot(SEAT_MM, STOPS_MM))
    places = sockets + rng.normal(0.0, 1.0, sockets.shape) * scatter
    arm = with_ball(model.arm, touch_of(rig))
    for _ in range(_STEPS):
        path = visits(table.q, table.came_from)
        away = places - np.asarray(moved(replace(model, arm=arm), path).T[:, :3, 3])
        if np.abs(away).max() < _THERE_MM:
            break
        _, jacobian = forward_and_jacobian(arm, table.q)
        table = replace(table, q=table.q + np.einsum("nij,nj->ni", np.linalg.pinv(jacobian[:, :3]), away))
    return _standing(rig, table)


def _standing(rig: Rig, table: TouchTable) -> TouchTable:
    if rig.robot.rail is None:
        return table
    assert table.came_from is not None  # noqa: S101 - planned touches say it
    stands = np.zeros(len(table.q))
    q, came_from = (np.column_stack([angles, stands]) for angles in (table.q, table.came_from))
    return replace(table, q=q, came_from=came_from, rail=True)


def _planned(rig: Rig, rng: np.random.Generator) -> tuple[TouchTable, Array]:
    touch, q, places, names = touch_of(rig), [], [], []
    arm = with_ball(arm_of(rig.robot), touch)
    count = -(-touch.touches // len(touch.sockets))
    where: dict[str, Array] = {}
    for socket in touch.sockets:
        # Sockets with a position (3,) mm and a known distance in mm from this one.
        pairs = {frozenset(stated.between): stated.distance_mm for stated in touch.distances}
        distances = [
            (place, pairs[pair]) for placed, place in where.items() if (pair := frozenset((socket, placed))) in pairs
        ]
        place, postures = _somewhere(arm, count, rng, rig.name, distances)
        where[socket] = place
        q.append(postures)
        places += [place] * count
        names += [socket] * count
    order = np.concatenate(q)
    swing = rng.choice([-1.0, 1.0], order.shape) * rng.uniform(*_APPROACH_RAD, order.shape)
    return TouchTable(np.array(names), order, order + swing), np.array(places)


def _somewhere(
    arm: Arm, count: int, rng: np.random.Generator, where: str, distances: Sequence[tuple[Array, float]]
) -> tuple[Array, Array]:
    """A random socket position at given distances from others, and postures (count, axes) rad."""
    low, high = arm.limits.T
    free = forward(arm, rng.uniform(low, high, (_POSTURES, arm.axes)))[:, :3, 3]
    base = arm.T_world_base[:3, 3]
    at = free
    if distances:  # moved to satisfy the known distances, as far as possible
        others, apart_mm = np.array([place for place, _ in distances]), np.array([mm for _, mm in distances])
        for _ in range(_STEPS):
            away = at[:, None] - others
            apart = np.linalg.norm(away, axis=2)
            at = at + np.einsum("nij,nj->ni", np.linalg.pinv(away / apart[..., None]), apart_mm - apart)
        misses = np.abs(np.linalg.norm(at[:, None] - others, axis=2) - apart_mm)
        at = at[misses.max(axis=1) < _THERE_MM]
    share = np.linalg.norm(at - base, axis=1) / np.linalg.norm(free - base, axis=1).max()
    for place in at[(share > _REACHED[0]) & (share < _REACHED[1]) & (at[:, 2] > base[2])]:
        postures = postures_at(arm, place, count, rng)
        if len(postures) == count:
            return place, postures
    remedy = "check tests.touch.distances, and limits_deg" if distances else "check limits_deg"
    raise FileError(
        f"rig {where}", "the arm has no place for a socket with enough postures", remedy, code="rig_file.invalid"
    )


def postures_at(arm: Arm, place: Array, count: int, rng: np.random.Generator) -> Array:
    """Random postures (at most count, axes) rad with the tool at a position in any orientation.

    Each joint stays within a turn about the middle of its range: an arm on its way from touch to touch is not wound up.
    """
    low, high = arm.limits.T
    free = _OFF_LIMIT * (high - low)
    postures = np.empty((0, arm.axes))
    for _ in range(_TRIES):
        q = rng.uniform(low, high, (_POSTURES, arm.axes))
        for _ in range(_STEPS):
            T, jacobian = forward_and_jacobian(arm, q)
            step = np.einsum("nij,nj->ni", np.linalg.pinv(jacobian[:, :3]), place - T[:, :3, 3])
            q = q + np.clip(step, -_LARGEST_RAD, _LARGEST_RAD)
        at_place = np.linalg.norm(forward(arm, q)[:, :3, 3] - place, axis=1) < _THERE_MM
        kept = q[at_place & (q > low + free).all(axis=1) & (q < high - free).all(axis=1)]
        postures = np.concatenate([postures, kept])
        if len(postures) >= count:
            break
    middle: Array = (low + high) / 2
    return middle + wrapped(postures[:count] - middle)


def with_ball(arm: Arm, touch: Touch) -> Arm:
    ball = moved_by(np.eye(4), np.array(touch.ball_mm), np.zeros(3))
    return replace(arm, T_flange_tool=arm.T_flange_tool @ ball)


_FAR_MM = 3000.0
"""Distance of the tracker from the base."""
_RATE_HZ = 100.0
"""Positions per second; trackers record ten times as many, without more information about a simulated arm."""
_PATH_STEPS = 2000
"""Steps along each path with linear joint interpolation: on the circles the deviation is below 1 µm."""


def simulated_cube(rig: Rig, seed: int | None, effects: Sequence[Effect] | None = None) -> tuple[Array, Array, Array]:
    """Joints (n, 6) rad, positions (n, 3) mm in the tracker frame, and the previous joints of the cube poses.

    seed: None for no noise. Raises FileError if the cube does not fit into the work space.
    """
    q, rng = cycle_stops(rig), np.random.default_rng(seed or 0)
    noise = 0.0 if seed is None else float(np.hypot(TRACKER_MM, STOPS_MM))
    from_start = np.concatenate([cube_of(rig).q[:1], q])
    places = tool_places(model_of(rig, effects), from_start)[1:] + noise * rng.standard_normal((len(q), 3))
    return q, seen_by_tracker(rig, places, rng), from_start[:-1]


def simulated_path(rig: Rig, seed: int | None, effects: Sequence[Effect] | None = None) -> tuple[Array, Array]:
    """Times (n,) s and positions (n, 3) mm of the paths at full speed. See `simulated_cube`."""
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
    s = np.linspace(0.0, path.length_mm, _PATH_STEPS)
    s = np.unique(np.concatenate([s, path.arc_length_mm])) if isinstance(path, Polygon) else s
    q = joints_along(arm, cube, path, s, where)
    ramp_s = min(speed_mm_s / ACCELERATION_MM_S2, float(np.sqrt(path.length_mm / ACCELERATION_MM_S2)))
    whole_s = path.length_mm / (ACCELERATION_MM_S2 * ramp_s) + ramp_s
    t = np.arange(0.0, whole_s + STANDSTILL_S, 1 / _RATE_HZ)
    speed = ACCELERATION_MM_S2 * np.clip(np.minimum(t, whole_s - t), 0.0, ramp_s)
    driven = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2) / _RATE_HZ])
    driven = np.clip(driven * path.length_mm / driven[-1], 0.0, path.length_mm)
    return np.stack([np.interp(driven, s, column) for column in q.T], axis=1)


def tool_places(model: Model, q: Array) -> Array:
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


def simulate(
    rig: Rig,
    test: TestName,
    direction: Direction | None,
    seed: int | None,
    effects: Sequence[Effect] | None = None,
    noise: Noise | None = None,
) -> Table:
    """Simulate a run of a test; `seed` None for no noise.

    effects: in place of those of the rig file. Poses and paths are those of ISO 9283. Raises FileError if the robot
    cannot do the test.
    """
    require_test(rig, test)
    return kind_of(test).simulated(rig, direction, Simulation(seed, effects, noise))


def noise_seed(seed: int, direction: Direction | None) -> int:
    return 2 * seed + (direction == "cw")


def simulated_run(
    rig: Rig,
    rig_text: str,
    test: TestName,
    direction: Direction | None,
    seed: int | None,
    effects: Sequence[Effect] | None = None,
    noise: Noise | None = None,
) -> Measured:
    """A simulated run like a measured one, named after test, direction and seed. Raises FileError.

    seed: of the noise, different in both directions; None for no noise. effects: in place of those of the rig. The run
    contains the rig file, without the simulated effects; its source states the seed.
    """
    draw = None if seed is None else noise_seed(seed, direction)
    run = table_run(
        pathlib.Path("-".join(filter(None, [test, direction, "exact" if seed is None else f"{seed:03d}"]))),
        columns_of(simulate(rig, test, direction, draw, effects, noise)),
        test=test,
        direction=direction,
        rig_name=rig.name,
        rig_text=rig_text,
        operator="rig simulate",
        source=f"{SIMULATED}{'no noise' if seed is None else f'seed {seed}'}",
        source_sha256=hashlib.sha256(repr(effects or rig.effects).encode()).hexdigest(),
    )
    return measured_of(run, rig_of(run).calibrated_as(rig))
