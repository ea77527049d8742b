"""Readings that a cell can take, and their simulated responses to everything unknown about the arm.

Without a usable calibration that is the typical size of every effect, and the place of every instrument; then the
covariance of its parameters, with a known set-up.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from analysis.apps.planning.circle_candidates import CircleCandidate, circle_candidates, circle_minutes
from analysis.apps.planning.pose_pool import Sight, drawn_poses, joint_ranges
from analysis.apps.planning.reading_pool import ReadingPool, as_readings
from analysis.correction.support import why_nothing
from analysis.correction.work import TaughtFrame
from analysis.diagnosis.evidence.blocks import Block, blocks_of
from analysis.diagnosis.evidence.observation import by_socket, observe_run, socket_of
from analysis.diagnosis.fit.candidates import Columns, Level, candidates_for, columns_for
from analysis.diagnosis.fit.responses import Linearisation, linearise
from analysis.diagnosis.plan.expected import planned_blocks, without_bands
from analysis.procedures.shared.test_kind import nominal_setup
from analysis.procedures.simulate import planned_touches, postures_at, with_ball
from analysis.robot.geometry.clearance import chain_points
from analysis.robot.geometry.driven_programs import circle_program
from analysis.robot.kinematics.arm import Array, Integers, arm_of, forward
from analysis.robot.predict import SetUp, model_of
from analysis.runs.tables import PoseTable, TouchTable
from rigs.calibration import TIMES, CalibratedModel
from rigs.effects import Effect, size_field
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.effect import healthy_size, is_play
from rigs.schema.vocabulary import CIRCLES

_POSES, _TOUCHES, _DRAWN, _SEED = 150, 60, 5, 0
"""Number of possible poses, of possible touches of each socket, and of postures drawn for each of these."""
_POSE_MIN, TOUCH_MIN, _CIRCLE_RUNS = 1.5, 0.5, 1
"""Minutes of a pose and of a touch, and runs of each circle in each direction. Chosen."""
_ABOVE_MM = 50.0
"""Least height of elbow and wrist above the mounting plane at a touch: sockets stand on the table."""
_LEVEL = 5.0
"""Size of unknown errors, in healthy sizes, by the angles of a real UR10 (docs/evidence/ur10.md)."""
_SET_UP_SIGMA = 30.0
"""Prior of instrument and target, in noise standard deviations of a reading: practically unknown, without rounding
errors."""
_SMALL = 1e-3
"""Step of a parameter: share of a healthy size, or of a shape."""
_MOST_ENTRIES = 60
"""Number of combinations of the entries of a circle that are weighed. Chosen."""
_INDISTINCT = 1e-6
"""Relative singular value below which readings do not determine a term of a set-up."""
_SMOOTH = 5.0
"""Unexplained error of an order of a circle, relative to that at an angle: about 16 orders hold the power of 360
angles."""


@dataclass(frozen=True)
class Reading:
    """A pose or touch at joint angles q (axes,) rad, or a circle."""

    kind: Literal["pose", "touch", "circle"]
    minutes: float
    q: Array | None = None
    socket: str = ""
    circle: CircleCandidate | None = None

    @property
    def words(self) -> str:
        if self.circle is not None:
            return f"drive a circle ({self.circle.words})"
        angles = ", ".join(f"{angle:z.1f}" for angle in self.q_deg or ())
        return f"{f'touch socket {self.socket}' if self.socket else 'measure'} at joint angles {angles}°"

    @property
    def noun(self) -> str:
        return {"pose": "poses", "touch": "touches", "circle": "circles"}[self.kind]

    @property
    def q_deg(self) -> list[float] | None:
        return None if self.q is None else np.degrees(self.q).round(3).tolist()

    def to_dict(self) -> dict[str, Any]:
        circle = self.circle and self.circle.words
        return {"reading": self.kind, "q_deg": self.q_deg, "socket": self.socket or None, "circle": circle}


def possible_readings(rig: Rig, sight: Sight | None = None) -> list[Reading]:
    """Readings of the instruments that calibrated an arm, otherwise of those in its rig file.

    sight: of a tracker, which then takes all readings.
    """
    by_gauges = bool(rig.gauges.recorded) and rig.tests.circle is not None
    by_sockets = rig.tests.touch is not None
    if rig.calibrated is not None:
        by_gauges = by_gauges and any(setup.ball_mm for setup in rig.calibrated.setups.values())
        by_sockets = by_sockets and rig.calibrated.reach_mm is not None
    readings = list[Reading]()
    if by_sockets and sight is None:
        readings += touches_at(rig, _socket_places(rig))
    if by_gauges and sight is None:
        readings += [Reading("circle", circle.minutes, circle=circle) for circle in _circles(rig)]
    return readings or poses_at(drawn_poses(arm_of(rig.robot), _POSES, sight, np.random.default_rng(_SEED)))


def poses_at(q: Array) -> list[Reading]:
    return [Reading("pose", _POSE_MIN, posture) for posture in q]


def _circles(rig: Rig) -> list[CircleCandidate]:
    """Circles with the same link, tool and speed: those at other places and, before a calibration, that of the rig."""

    def driven(rig: Rig) -> tuple[object, ...]:
        circle = rig.tests.circle
        return rig.robot, circle and circle.radius_mm, circle and circle.speed_mm_s

    found, _ = circle_candidates(rig, CIRCLES, _CIRCLE_RUNS)
    circles = [one for one in found if driven(one.rig) == driven(rig)]
    if rig.calibrated is None:
        with suppress(FileError):  # the arm cannot drive it
            minutes = circle_minutes(float(circle_program(rig, "acw").t_s[-1]), CIRCLES, _CIRCLE_RUNS)
            circles.insert(0, CircleCandidate(rig, "that of the rig file", minutes))
    return circles


def touches_at(rig: Rig, places: dict[str, Array]) -> list[Reading]:
    touch, rng = rig.tests.touch, np.random.default_rng(_SEED)
    assert touch is not None  # noqa: S101 - asked before
    arm = with_ball(arm_of(rig.robot), touch)
    low, high = joint_ranges(arm)
    touches = []
    for socket, place in places.items():
        q = postures_at(arm, place, _DRAWN * _TOUCHES, rng)
        q = (q + np.pi) % (2 * np.pi) - np.pi  # the same posture without turns of a cable
        above_mm = chain_points(arm, q)[:, 2:-1, 2].min(axis=1)
        q = q[((q >= low) & (q <= high)).all(axis=1) & (above_mm > _ABOVE_MM)]
        touches += [Reading("touch", TOUCH_MIN, posture, socket) for posture in q[:_TOUCHES]]
    return touches


def _socket_places(rig: Rig) -> dict[str, Array]:
    """Places (3,) mm of the sockets: the calibrated ones, otherwise within reach, as in a simulation."""
    if rig.calibrated and rig.calibrated.reach_mm is not None:
        placed = {socket_of(name): setup.T_instrument_world for name, setup in rig.calibrated.setups.items()}
        return {socket: -np.array(T)[:3, 3] for socket, T in placed.items() if socket and T}
    table, touch = planned_touches(rig), rig.tests.touch
    assert touch is not None  # noqa: S101 - asked before
    balls = forward(with_ball(arm_of(rig.robot), touch), table.q)[:, :3, 3]
    return {socket: balls[table.socket == socket][0] for socket in touch.sockets}


def pool_of_readings(rig: Rig, readings: Sequence[Reading], q: Array, taught: Array) -> ReadingPool:
    """Pool of possible readings for targets at q (n, axes) rad.

    taught (m, axes) rad: postures at which the frame and tool of the targets are taught.
    """
    arm = arm_of(rig.robot)
    blocks, setups, owners = _simulate_readings(rig, readings)
    frame = block_of(rig, pose_table(rig, np.concatenate([taught, q])), "targets")
    linear = linearise(without_bands([*blocks, frame[0]]), setups | {frame[0].setup: frame[1]})
    of_frame = linear.rows[-1]
    if rig.calibrated and not why_nothing(rig):
        rows = _calibrated_rows(linear, rig.calibrated)
    else:
        columns = typical_columns(linear)
        rows = typical_rows(columns)
        rows[of_frame.start : of_frame.stop, columns.fixed > 0] = 0.0  # targets belong to no set-up
    displaced = (rows[of_frame] * frame[0].sd_mm[:, None]).T.reshape(rows.shape[1], -1, 3)
    taught_frame, poses = TaughtFrame(forward(arm, taught)), forward(arm, q)
    motions = taught_frame.motions(displaced[:, : len(taught)])
    targets = taught_frame.remove_motions(displaced[:, len(taught) :], poses, motions)
    owner, entries = np.concatenate(owners), rows[: of_frame.start]
    possible = as_readings([_compressed(entries[owner == k]) for k in range(len(readings))])
    minutes = np.array([reading.minutes for reading in readings])
    pool = ReadingPool(possible, targets.reshape(len(targets), -1).T, minutes)
    return pool.after(rows[linear.of_distances])


def _simulate_readings(rig: Rig, readings: Sequence[Reading]) -> tuple[list[Block], dict[str, SetUp], list[Integers]]:
    """Simulate readings as blocks with set-ups, and say to which reading each entry belongs (N,)."""
    found = list[tuple[Block, SetUp, Integers]]()
    at_angles = [(reading.kind != "pose", reading.socket) for reading in readings if reading.circle is None]
    for is_touch, socket in dict.fromkeys(sorted(at_angles, key=lambda one: one[0])):
        rows = [k for k, one in enumerate(readings) if one.circle is None and one.socket == socket]
        q = np.array([readings[k].q for k in rows])
        table = TouchTable(np.full(len(q), socket), q) if is_touch else pose_table(rig, q)
        found.append((*block_of(rig, table), np.repeat(rows, 3)))
    setups = {block.setup: setup for block, setup, _ in found}
    for k, reading in enumerate(readings):
        if reading.circle is not None:
            driven, placed = planned_blocks(reading.circle.rig, CIRCLES, _CIRCLE_RUNS, f" circle {k}")
            found += [(block, placed[block.setup], np.full(len(block.y_mm), k)) for block in driven]
            setups |= placed
    return [block for block, _, _ in found], setups, [owner for _, _, owner in found]


def pose_table(rig: Rig, q: Array) -> PoseTable:
    return PoseTable(q, np.zeros((len(q), 3)), None, rail=rig.robot.rail is not None)


def block_of(rig: Rig, table: PoseTable | TouchTable, setup: str = "") -> tuple[Block, SetUp]:
    """Planned readings, touches of a single socket, as a block of a diagnosis with its set-up.

    setup: suffix of the name of the set-up.
    """
    placed = nominal_setup(rig, table)
    if isinstance(table, TouchTable):  # the known distances need the places of the sockets
        balls = forward(arm_of(rig.robot), table.q) @ placed.T_tool_target
        placed.T_instrument_world[:3, 3] = -balls[:, :3, 3].mean(axis=0)
    (run,) = by_socket(observe_run(model_of(rig), table, rig.name))
    run = replace(run, setup=f"{run.setup} {setup}".strip())
    (block,) = blocks_of([run], {run.setup: placed})
    return block, placed


def typical_columns(linear: Linearisation) -> Columns:
    """Columns of a diagnosis for readings, without backlash, which depends on the order of poses."""
    return columns_for(linear, [candidate for candidate in candidates_for(linear) if not is_play(candidate.effect)])


def typical_rows(columns: Columns) -> Array:
    """Rows (N, k) of an arm with typical errors and of unknown set-ups."""
    variance = columns.variance(Level(_LEVEL))
    of_set_ups = columns.X[:, columns.set_ups]
    seen = np.maximum((of_set_ups != 0).sum(axis=0), 1)
    variance[columns.set_ups] = _SET_UP_SIGMA**2 * seen / np.maximum((of_set_ups**2).sum(axis=0), 1e-12)
    return np.asarray(columns.X * np.sqrt(variance))


def _calibrated_rows(linear: Linearisation, calibrated: CalibratedModel) -> Array:
    """Rows (N, P) of the unknowns of a calibration, in standard deviations of noise and unexplained error.

    What the known set-up of further readings absorbs is no information.
    """
    rows = _parameter_rows(linear, calibrated)
    read = slice(0, linear.rows[-1].start)
    placed = linear.U[read]
    rows[read] -= placed @ (np.linalg.pinv(placed, _INDISTINCT) @ rows[read])
    rows[linear.of_distances] = 0.0
    judged = calibrated.judged
    noise, unexplained = (judged.noise_um / 1e3, judged.unexplained_um / 1e3) if judged else (0.0, 0.0)
    for block, of_block in zip(linear.blocks[:-1], linear.rows, strict=False):
        least, rest = (0.0, _SMOOTH * unexplained) if block.sampling else (noise, unexplained)
        rows[of_block] *= (block.sd_mm / np.hypot(np.maximum(block.sd_mm, least), rest))[:, None]
    return rows


def _parameter_rows(linear: Linearisation, calibrated: CalibratedModel) -> Array:
    """Change (N, P) of the whitened readings by the independent unknowns of a calibration, without backlash."""
    terms = [calibrated.terms[parameter.term].effect for parameter in calibrated.parameters]
    kept = [k for k, effect in enumerate(terms) if not is_play(effect)]
    slopes, changes = linear.columns([terms[k] for k in kept]), dict[int, tuple[Effect, float]]()
    for column, k in enumerate(kept):
        field = calibrated.parameters[k].field
        if field != TIMES:
            step = _SMALL * (healthy_size(terms[k]) if field == size_field(terms[k]) else 1.0)
            update = {field: getattr(terms[k], field) + step}
            changes[column] = terms[k].model_copy(update=update), step
    stepped = linear.columns([effect for effect, _ in changes.values()])
    slopes[:, list(changes)] = (stepped - slopes[:, list(changes)]) / [step for _, step in changes.values()]
    return np.asarray(slopes @ calibrated.root[kept])


def _compressed(entries: Array) -> Array:
    """Combinations of the entries (e, k) of a circle that show most (Halko, Martinsson and Tropp, SIAM Review 53,
    2011)."""
    if len(entries) <= _MOST_ENTRIES:
        return entries
    seen = entries @ np.random.default_rng(_SEED).standard_normal((entries.shape[1], _MOST_ENTRIES))
    for _ in range(2):
        seen = np.linalg.qr(entries @ (entries.T @ np.linalg.qr(seen)[0]))[0]
    return np.asarray(seen.T @ entries)
