"""Location of a fixed ball through stops of the robot, and detection of touches.

A robot at rest after a motion has seated the ball in the socket if the nominal arm agrees within the usual errors of
arms; otherwise it just rests. The last turning point of each joint gives the side of its play.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from analysis.robot.kinematics.arm import Arm, Array, arm_of, forward
from analysis.runs.align import align, robot_only
from analysis.runs.stands import FLICKER_DEG, stands_of
from analysis.runs.tables import TargetTable, TouchTable, table_from
from daq.store import Run
from rigs.edit import Values
from rigs.errors import FileError
from rigs.rig import Rig

_APART_MM = 5.0
"""Largest distance of two stops at the same place."""


def distinct_places(places: Array) -> Array:
    apart: list[Array] = []
    for place in places:
        if all(np.linalg.norm(place - earlier) > _APART_MM for earlier in apart):
            apart.append(place)
    return np.array(apart).reshape(-1, 3)


def scatter(squares: float, free: int, within_mm: float) -> tuple[float, tuple[str, ...]]:
    """Scatter in mm of a coordinate, widened by Student's t factor so that 2 u covers 95 % for few points.

    Without degrees of freedom it is the scatter within the stops, with a warning.
    """
    if free <= 0:
        warning = "a fit to so few points has no residual: u includes only the scatter within the stops; add a point"
        return within_mm, (warning,)
    from scipy.special import stdtrit  # noqa: PLC0415 - slow to import, needed here only

    return float(np.sqrt(squares / free) * stdtrit(free, 0.975) / 1.96), ()


# Location of a fixed ball from places of the tool on a sphere of unknown radius about it. If a gauge on the link was
# read, each distance is corrected by the reading.

_ROUNDS = 20
"""Gauss-Newton steps after the algebraic fit; a short cap of a sphere needs most of them."""
_OFF_BALL_MM = 10.0
"""Largest distance of a stop from the sphere: the errors of an arm bend a hemisphere by some mm."""
_OTHERS_OF_BALL = 1 / 8
"""Largest share of stops elsewhere: the home position before and after the program."""
GAUGE_MM = 5.0
"""Largest 2 u: the ball is mounted at the centre, and a gauge reads about 5 mm in both directions."""


@dataclass(frozen=True)
class TouchedBall:
    centre: Array
    u_centre_mm: Array
    """Standard uncertainty (3,) of the centre."""
    radius_mm: float
    values: Values
    """Keys of tests.hemisphere: the centre, and all keys if the rig file has none."""
    used: str
    doubts: tuple[str, ...]


def touched_ball(runs: Sequence[Run], rig: Rig) -> TouchedBall:
    where = ", ".join(str(run.path) for run in runs)
    stands, run_doubts = zip(*(_read_stands(run, rig) for run in runs), strict=True)
    q, g_mm, within = (np.concatenate(parts) for parts in zip(*stands, strict=True))
    places = forward(arm_of(rig.robot), q)[:, :3, 3]
    if (apart := len(distinct_places(places))) < 4:
        problem = f"the robot was at rest at {apart} places, but a ball needs four that are not in a plane"
        remedy = "stop at more places all over the hemisphere, for a second at each"
        raise FileError(where, problem, remedy, code="readings.too_few")
    # Drop stops far off the sphere of the others one by one.
    near = np.ones(len(places), dtype=bool)
    for _ in range(int(_OTHERS_OF_BALL * len(places))):
        off = np.abs(_distance_from_sphere(places, g_mm, _sphere(places[near], g_mm[near])[0])) * near
        if off.max() < _OFF_BALL_MM:
            break
        near[int(off.argmax())] = False
    off_sphere = len(q) - int(near.sum())
    q, g_mm, within, places = q[near], g_mm[near], within[near], places[near]
    x, design = _sphere(places, g_mm)
    residual = _distance_from_sphere(places, g_mm, x)
    if not np.isfinite(x).all() or np.linalg.cond(design) > 1e6:
        problem = "the stops are in a plane, which does not determine a ball"
        raise FileError(where, problem, "also stop at higher and lower places", code="readings.unsuitable")
    if np.abs(residual).max() > _OFF_BALL_MM:
        worst = int(np.abs(residual).argmax())
        problem = (
            f"stand {worst + 1} of {len(residual)} lies {abs(residual[worst]):.1f} mm from a sphere about the ball"
        )
        remedy = "record only stops at which the link or the ball fixed the tool"
        raise FileError(where, problem, remedy, code="readings.unsuitable")
    scatter_mm, few = scatter(float((residual**2).sum()), len(residual) - 4, float(np.sqrt(np.mean(within**2))))
    u_mm = scatter_mm * np.sqrt(np.diag(np.linalg.inv(design.T @ design)))[:3]
    used = f"{len(q)} stops on a sphere of {x[3]:.1f} mm"
    if 2 * u_mm.max() > GAUGE_MM:
        problem = f"the ball position from {used} has an uncertainty of {u_mm.max():.3g} mm (u), which is too large"
        remedy = "stop at places farther apart, all over the hemisphere"
        raise FileError(where, problem, remedy, code="readings.unsuitable")
    doubts = (*(doubt for of_run in run_doubts for doubt in of_run), *few)
    if off_sphere:
        doubts = (*doubts, f"{off_sphere} stops are not used because they are off the sphere of the others")
    values: dict[str, float | list[float]] = {"centre_mm": [round(float(value), 3) for value in x[:3]]}
    if rig.tests.hemisphere is None:
        pole = int(places[:, 2].argmax())  # the default normal points upwards
        values["radius_mm"] = round(float(x[3]), 3)
        values["posture_deg"] = [round(float(angle), 2) for angle in np.degrees(q[pole])]
    return TouchedBall(x[:3], u_mm, float(x[3]), values, used, doubts)


def _read_stands(run: Run, rig: Rig) -> tuple[tuple[Array, Array, Array], tuple[str, ...]]:
    """Angles (m, 6) in rad, readings (m,), 0 without a gauge, and scatter (m,) in mm of the stops of a run."""
    path, manifest = run.path, run.manifest
    if run.table is not None:
        table = table_from(run.table, manifest.test, manifest.direction, str(path))
        if not isinstance(table, TargetTable):
            problem = f"is a {manifest.test} table, which lacks stops about a ball"
            raise FileError(str(path), problem, "give a radial run", code="readings.unsuitable")
        return (table.q, table.g_mm, np.zeros(len(table.q))), ()
    doubts: tuple[str, ...] = ()
    try:
        data = align(path, run.streams, run.manifest.test, rig)
        t_s, q, g_mm, doubts = data.t_s, data.q, data.g_mm[:, :1], data.doubts
    except FileError as error:
        t_s, q, alone_doubts = robot_only(path, run)
        g_mm = np.zeros((len(t_s), 1))
        missing = f"gauge g1 is missing ({error.what}), so all distances from the ball are assumed equal"
        doubts = (*alone_doubts, missing)
    stands = stands_of(t_s, q, g_mm)
    arm = arm_of(rig.robot)
    within = [forward(arm, q[stand.settled])[:, :3, 3].std(axis=0).mean() for stand in stands]
    angles = np.array([stand.q for stand in stands]).reshape(-1, 6)
    return (angles, np.array([stand.g_mm[0] for stand in stands]), np.array(within)), doubts


def _distance_from_sphere(places: Array, g_mm: Array, x: Array) -> Array:
    return np.asarray(np.linalg.norm(places - x[:3], axis=1) - g_mm - x[3])


def _sphere(places: Array, g_mm: Array) -> tuple[Array, Array]:
    """Fit centre B and radius R (4,) with ‖p - B‖ = R + g, with the Jacobian (m, 4) of the distances."""
    middle = places.mean(axis=0)
    from_middle = places - middle
    algebraic = np.column_stack([2 * from_middle, np.ones(len(places))])
    x = np.linalg.lstsq(algebraic, (from_middle**2).sum(axis=1), rcond=None)[0]
    x = np.append(middle + x[:3], np.sqrt(max(x[3] + x[:3] @ x[:3], 1.0)))
    for _ in range(_ROUNDS):
        away = places - x[:3]
        distance = np.linalg.norm(away, axis=1)
        design = np.column_stack([away / np.maximum(distance, 1e-9)[:, None], np.ones(len(places))])
        x = x + np.linalg.lstsq(design, distance - g_mm - x[3], rcond=None)[0]
    return x, design


REST_S = 1.5
"""Rest time before a touch is accepted: a released arm swings for some tenths of a second."""
_MOVED_DEG = 3.0
"""Minimum motion of a joint between touches: a repeated posture adds only scatter."""
_TURNED_DEG = 0.02
"""Motion of a joint beyond which it has reversed. Smaller changes are encoder flicker."""
_SAME_MM = 30.0
"""Largest distance of the ball from the first touch of a socket: a nominal arm is up to 10 mm wrong."""

Seen = Literal["seated", "elsewhere", "same posture"]
"""A touch accepted, a position outside the socket, or a repeated posture."""


def is_same_posture(q_deg: Array, other_deg: Array) -> bool:
    """True if no joint differs by more than a hand moves by accident."""
    return bool(np.abs(q_deg - other_deg).max() < _MOVED_DEG)


class RestDetector:
    """Detects each standstill once, and the angle from which each joint came in a constant direction."""

    came_deg: Array

    def __init__(self) -> None:
        self._at, self._since_s, self._is_told = np.empty(0), 0.0, False

    def feed(self, t_s: float, q_deg: Array) -> bool:
        """True once joint angles (axes,) in degrees have been at rest long enough for a touch."""
        if not self._at.size:
            self.came_deg, self._furthest, self._way = q_deg.copy(), q_deg.copy(), np.zeros(len(q_deg))
        self._follow(q_deg)
        if not self._at.size or np.abs(q_deg - self._at).max() > FLICKER_DEG:
            self._at, self._since_s, self._is_told = q_deg, t_s, False
        if self._is_told or t_s - self._since_s < REST_S:
            return False
        self._is_told = True
        return True

    def _follow(self, q: Array) -> None:
        gone = q - self._furthest
        back = gone * np.where(self._way == 0, -np.sign(gone), self._way)
        turned = back < -_TURNED_DEG
        self.came_deg = np.where(turned, self._furthest, self.came_deg)
        self._way = np.where(turned, np.sign(gone), self._way)
        self._furthest = np.where(turned | (gone * self._way > 0), q, self._furthest)


class Touching:
    def __init__(self, arm: Arm, sockets: Sequence[str], touches: int) -> None:
        """arm: with the ball as the tool. touches: total number for all sockets."""
        self._arm, self._sockets = arm, tuple(sockets)
        self.each = -(-touches // len(sockets))
        """Number of touches per socket."""
        self._names: list[str] = []
        self._q: list[Array] = []
        self._came: list[Array] = []
        self._first_mm = np.zeros(3)
        self._elsewhere: tuple[Array, Array, Array] | None = None

    @property
    def socket(self) -> str:
        done = len(self._names) // self.each
        return self._sockets[done] if done < len(self._sockets) else ""

    @property
    def number(self) -> int:
        return len(self._names) % self.each + 1

    @property
    def count(self) -> int:
        return len(self._names)

    @property
    def table(self) -> TouchTable:
        return TouchTable(np.array(self._names), np.radians(self._q), np.radians(self._came))

    def take(self, q: Array, came: Array) -> Seen:
        """Take a standstill at joint angles q (axes,) in degrees as a touch, if the ball is seated in the socket.

        came (axes,): angles from which the joints came, in degrees.
        """
        if self._q and is_same_posture(q, self._q[-1]):
            return "same posture"
        ball = forward(self._arm, np.radians(q)[None])[0, :3, 3]
        if self.number == 1:
            self._first_mm, self._elsewhere = ball, None
        elif np.linalg.norm(ball - self._first_mm) > _SAME_MM and not self._replaces_first(ball, q):
            self._elsewhere = ball, q, came
            return "elsewhere"
        self._names.append(self.socket)
        self._q.append(q)
        self._came.append(came)
        return "seated"

    def _replaces_first(self, ball: Array, q: Array) -> bool:
        """Replace the first touch of this socket if the last standstill and this one agree on another place.

        The robot may stand anywhere at the start, or stop on its way to the next socket.
        """
        if self.number != 2 or self._elsewhere is None:
            return False
        place, before, came = self._elsewhere
        if np.linalg.norm(ball - place) > _SAME_MM or is_same_posture(q, before):
            return False
        self._first_mm, self._q[-1], self._came[-1] = place, before, came
        return True
