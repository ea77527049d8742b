"""Cells: an arm with healthy errors and at most one unknown cause, and the measured runs.

Three set-ups: `pose` (a tracker measures a target at some hundred stops), `touch` (a pointer in two sockets, only
joints are read) and `circle` (the ball link: yaw twice in each direction, and the hemisphere).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np
from scipy.linalg import orth

from tests.worlds.unknown.arms import (
    Arm,
    Array,
    Deviation,
    UnreachableError,
    elbow_arm,
    forward,
    gravity_torque,
    inverse,
    no_deviation,
    point,
    seven_axis_arm,
    small_motion,
    ur10e,
)
from tests.worlds.unknown.ball import (
    SPEED_MM_S,
    TOOL,
    Circle,
    Hemisphere,
    Link,
    Targets,
    circle_motion,
    circle_path,
    gauge_readings,
    hemisphere_targets,
)
from tests.worlds.unknown.causes import CAUSES, Cause, ToolSlip, log_uniform
from tests.worlds.unknown.motion import Motion, stops

ARMS = {"ur10e": ur10e, "elbow": elbow_arm, "seven": seven_axis_arm}
POSES, REPEATED, TOUCHES, ELSEWHERE = 100, 12, 60, 60
RATE_HZ = 25.0
RUN_APART_S = 180.0
BALL_MM = np.array([50.0, 20.0, 100.0])
SOCKETS = {"A": np.array([-600.0, -250.0, 150.0]), "B": np.array([-600.0, 150.0, 150.0])}
CONSTANTS = ("a", "alpha", "d", "zero")
LEAST_NOISES, LEAST_OF_ITSELF, LEAST_OF_OTHERS, MOST_TRIES = 3.0, 0.15, 0.3, 40
"""Minimum residual of an unknown cause after fitting constants and set-up: three times the noise, 0.15 of the
complete cause, and 0.3 of the other errors of the arm (a tenth of their energy). Causes that constants imitate
better are excluded.
"""


@dataclass(frozen=True)
class Noise:
    """Noise of a cell: reading (mm, of a tracker coordinate or a gauge), wander of gauges (mm, over 0.5 s), scatter
    of a stop (mm, each coordinate of the tool), scatter of the joints between runs (rad).
    """

    reading_mm: float
    wander_mm: float
    stop_mm: float
    joint_rad: float


@dataclass(frozen=True)
class Known:
    """Healthy errors known to rig: constants of the arm, play (axes,) rad and compliance (axes,) rad/Nm."""

    a: Array
    alpha: Array
    d: Array
    zero: Array
    play: Array
    compliance: Array
    gear: tuple[int, int, float, float] = (0, 0, 0.0, 0.0)
    """Wave of one gear: axis, order per turn of the joint, amplitude in rad, phase in rad."""

    def arm(self, nominal: Arm) -> Arm:
        """Nominal arm with these deviations added to its constants."""
        return replace(nominal, **{name: getattr(nominal, name) + getattr(self, name) for name in CONSTANTS})

    def deviation(self, arm: Arm, motion: Motion) -> Deviation:
        """Deviations by backlash, gears and compliance along a motion."""
        found = no_deviation(len(motion.t), arm.axes)
        if self.compliance.any():
            found.joint[:] += gravity_torque(arm, motion.q) * self.compliance
        for k in np.flatnonzero(self.play):
            found.joint[:, k] += _play(motion.q[:, k], self.play[k])
        axis, order, amplitude, phase = self.gear
        if axis:
            found.joint[:, axis - 1] += amplitude * np.sin(order * motion.q[:, axis - 1] + phase)
        return found

    def names(self) -> dict[str, float]:
        """Size of each error by its name in rig, in degrees, mm and degrees per Nm."""
        found: dict[str, float] = {}
        for k in range(len(self.a)):
            found[f"joint_offset {k + 1}"] = float(np.degrees(self.zero[k]))
            found[f"link_geometry {k + 1}.d"] = float(self.d[k])
            found[f"backlash {k + 1}"] = float(np.degrees(self.play[k]))
            found[f"compliance {k + 1}"] = float(np.degrees(self.compliance[k]))
            if k + 1 < len(self.a):  # in rig a and alpha belong to the axis they lead to
                found[f"link_geometry {k + 2}.a"] = float(self.a[k])
                found[f"link_geometry {k + 2}.alpha"] = float(np.degrees(self.alpha[k]))
        if self.gear[0]:
            found[f"transmission_error {self.gear[0]}"] = float(np.degrees(self.gear[2]))
        return {name: size for name, size in found.items() if size}


def _play(q: Array, width: float) -> Array:
    """Deviation (n,) of a link with backlash: half the width behind the joint motion."""
    link = np.empty_like(q)
    link[0] = q[0]
    for i in range(1, len(q)):
        link[i] = min(max(link[i - 1], q[i] - width / 2), q[i] + width / 2)
    return link - q


def draw_known(rng: np.random.Generator, axes: int, rich: bool) -> Known:
    """Draw healthy errors: lengths 0.1 mm, angles and zeros 0.01 degrees; rich cells also have backlash and
    compliance.
    """
    degrees = np.radians(1.0)
    play, compliance = np.zeros(axes), np.zeros(axes)
    if rich:
        play[rng.integers(0, 3)] = rng.uniform(0.003, 0.010) * degrees
        compliance[:] = 1 / np.exp(rng.uniform(np.log(4e4), np.log(2e5), axes))
    return Known(
        a=rng.normal(0, 0.1, axes),
        alpha=rng.normal(0, 0.01, axes) * degrees,
        d=rng.normal(0, 0.1, axes),
        zero=rng.normal(0, 0.01, axes) * degrees,
        play=play,
        compliance=compliance,
    )


def no_known(axes: int) -> Known:
    """An arm without any error."""
    return Known(*[np.zeros(axes)] * 6)


@dataclass(frozen=True)
class Run:
    """A run of a cell in the format of an instrument. columns: by header, in degrees, mm and s."""

    name: str
    test: str
    direction: str
    columns: dict[str, Any]


@dataclass(frozen=True)
class Cell:
    """A random cell. test: `pose`, `touch` or `circle`; seed: of the noise; frame (4, 4): of the tracker.

    cause_um: rms of the cause; foreign_um: its residual after fitting constants and set-up; healthy_um: rms of the
    other errors of the arm.
    """

    arm_name: str
    test: str
    known: Known
    cause: Cause | None
    noise: Noise
    seed: int
    link: Link
    target: Array = field(default_factory=lambda: np.zeros(3))
    frame: Array = field(default_factory=lambda: np.eye(4))
    foreign_um: float = 0.0
    cause_um: float = 0.0
    healthy_um: float = 0.0
    states_approach: bool = False
    """Poses and touches have columns of the joints before the last move, which show backlash."""

    @property
    def nominal(self) -> Arm:
        return nominal_arm(self.arm_name, self.test)

    @property
    def arm(self) -> Arm:
        """The arm with its true constants."""
        return self.known.arm(self.nominal)

    def sound(self) -> Cell:
        """Same cell without the unknown cause."""
        return replace(self, cause=None)

    def deviation(self, motion: Motion) -> Deviation:
        """All deviations along a motion, without scatter."""
        found = self.known.deviation(self.nominal, motion)
        if self.cause is not None:
            found = found + self.cause.deviation(self.nominal, motion)
        return found


Planned = list[tuple[str, str, str, Motion]]
"""Name, test, direction and motion of each run, in order of time."""


@cache
def nominal_arm(name: str, test: str) -> Arm:
    """Nominal arm of a cell; with the ball link it carries 2 kg."""
    arm = ARMS[name]()
    return replace(arm, payload_kg=2.0) if test == "circle" else arm


# --- paths


@cache
def ball_paths() -> tuple[tuple[Array, Array], Targets]:
    """Joints of the circle and of the hemisphere targets of the nominal UR10e."""
    arm = nominal_arm("ur10e", "circle")
    return circle_path(arm, Circle()), hemisphere_targets(arm, Hemisphere())


def draw_postures(arm: Arm, count: int, rng: np.random.Generator) -> Array:
    """Draw postures (count, axes) in the ranges of the arm."""
    return rng.uniform(arm.low, arm.high, (count, arm.axes))


def circle_motions() -> Planned:
    path, targets = ball_paths()
    found: Planned = []
    for number in (1, 2):
        for direction, sense in (("acw", 1), ("cw", -1)):
            motion = circle_motion(path, sense, len(found) * RUN_APART_S, RATE_HZ)
            found.append((f"yaw-{direction}-{number}", "yaw", direction, motion))
    return [*found, ("radial", "radial", "", stops(targets.q, len(found) * RUN_APART_S))]


def touch_postures(arm: Arm, places: Array, rng: np.random.Generator) -> Array:
    """Find postures (n, axes) with the pointer's ball at places (n, 3), randomly tilted by up to 0.6 rad."""
    offset, found = np.eye(4), []
    offset[:3, 3] = BALL_MM
    for place in places:
        for _ in range(200):
            T = np.eye(4)
            lean = rng.uniform(-0.6, 0.6, 2)
            turn = small_motion(np.array([[0, 0, 0, lean[0], lean[1], 0], [0, 0, 0, 0, 0, rng.uniform(-2.5, 2.5)]]))
            T[:3, :3] = turn[0, :3, :3] @ np.diag([1.0, -1.0, -1.0]) @ turn[1, :3, :3]
            T[:3, 3] = place
            try:
                q = inverse(arm, T[None], offset, rng.uniform(arm.low, arm.high)[None], 40)[0]
            except (UnreachableError, np.linalg.LinAlgError):
                continue
            if (np.abs(q) < np.pi).all():
                found.append(q)
                break
        else:
            raise UnreachableError
    return np.array(found)


def motions(cell: Cell) -> Planned:
    rng = np.random.default_rng([cell.seed, 1])
    arm = cell.nominal
    if cell.test == "circle":
        return circle_motions()
    if cell.test == "pose":
        q = draw_postures(arm, POSES, rng)
        again = rng.choice(POSES, REPEATED, replace=False)
        return [("poses", "pose", "", stops(np.concatenate([q, q[again]])))]
    places = np.array([SOCKETS["AB"[k % 2]] for k in range(TOUCHES)])
    return [("touches", "touch", "", stops(touch_postures(arm, places, rng)))]


# --- readings


def runs(cell: Cell) -> list[Run]:
    rng = np.random.default_rng([cell.seed, 2])
    found = []
    for name, test, direction, motion in motions(cell):
        scatter = rng.normal(0, cell.noise.joint_rad, cell.nominal.axes)
        deviation = cell.deviation(motion).take(motion.rows)
        deviation.joint[:] += scatter
        measure = {"pose": _pose_columns, "touch": _touch_columns}.get(test, _gauge_columns)
        columns = measure(cell, test, motion, deviation, rng)
        if direction:
            columns["direction"] = [direction] * len(motion.rows)
        found.append(Run(name, test, direction, columns))
    return found


def _joint_columns(q: Array, suffix: str = "") -> dict[str, Any]:
    return {f"q{k + 1}{suffix}_deg": np.round(np.degrees(q[:, k]), 5) for k in range(q.shape[1])}


def _approach_columns(cell: Cell, q: Array) -> dict[str, Any]:
    return _joint_columns(np.concatenate([q[:1], q[:-1]]), "_from") if cell.states_approach else {}


def _pose_columns(cell: Cell, _: str, motion: Motion, deviation: Deviation, rng: np.random.Generator) -> dict[str, Any]:
    places = true_points(cell, motion.q_read, deviation)
    places = places + rng.normal(0, np.hypot(cell.noise.reading_mm, cell.noise.stop_mm), places.shape)
    columns = _joint_columns(motion.q_read) | _approach_columns(cell, motion.q_read)
    return columns | {f"{axis}_mm": np.round(places[:, k], 4) for k, axis in enumerate("xyz")}


def true_points(cell: Cell, q: Array, deviation: Deviation) -> Array:
    """True positions (n, 3) mm of the target in the tracker frame, or of the pointer's ball."""
    places = point(forward(cell.arm, q, deviation).flange, tool_point(cell) + deviation.tool)
    return places @ cell.frame[:3, :3].T + cell.frame[:3, 3]


def _touch_columns(
    cell: Cell, _: str, motion: Motion, deviation: Deviation, rng: np.random.Generator
) -> dict[str, Any]:
    """Simulate touches with a pointer guided into its sockets; the readings are the joint angles."""
    sockets = np.array([SOCKETS["AB"[k % 2]] for k in range(len(motion.rows))])
    sockets = sockets + rng.normal(0, np.hypot(cell.noise.reading_mm, cell.noise.stop_mm), sockets.shape)
    q = motion.q_read.copy()
    for _ in range(8):
        chain = forward(cell.arm, q, deviation)
        ball = point(chain.flange, BALL_MM + cell.target + deviation.tool)
        jacobian = np.cross(chain.axis, ball[:, None] - chain.origin)
        q = q + ((sockets - ball)[:, None] @ np.linalg.pinv(jacobian))[:, 0]
    return {"socket": ["AB"[k % 2] for k in range(len(q))]} | _joint_columns(q) | _approach_columns(cell, q)


def _gauge_columns(
    cell: Cell, test: str, motion: Motion, deviation: Deviation, rng: np.random.Generator
) -> dict[str, Any]:
    g = true_gauges(cell, test, motion, deviation)
    t = motion.t_read - motion.t[0]
    g = g + rng.normal(0, cell.noise.reading_mm, g.shape) + _wander(rng, t, cell.noise.wander_mm)[:, None]
    if test == "radial":
        g = g + rng.normal(0, cell.noise.stop_mm, g.shape)
    columns: dict[str, Any] = {"t_s": np.round(t, 4)} | _joint_columns(motion.q_read)
    columns |= {f"g{k + 1}_mm": np.round(g[:, k], 4) for k in range(g.shape[1])}
    if test == "radial":
        _, targets = ball_paths()
        columns |= {
            "target": targets.number.astype(int),
            "polar_deg": np.round(np.degrees(targets.polar), 3),
            "azimuth_deg": np.round(np.degrees(targets.azimuth), 3),
            "orientation": targets.orientation.astype(int),
        }
    return columns


def true_gauges(cell: Cell, test: str, motion: Motion, deviation: Deviation) -> Array:
    """Return noise-free gauge readings (m, 1 or 2) mm."""
    flange = forward(cell.arm, motion.q_read, deviation).flange
    tool = flange @ TOOL
    if cell.target.any() or deviation.tool.any():
        tool[:, :3, 3] = point(flange, TOOL[:3, 3] + cell.target + deviation.tool)
    place = Hemisphere() if test == "radial" else Circle()
    link = replace(cell.link, ball=cell.link.ball + place.centre)
    g = gauge_readings(tool, link, place.radius, test)
    return g + deviation.gauge[:, : g.shape[1]]


def _wander(rng: np.random.Generator, t: Array, size: float) -> Array:
    """A slow error (n,) common to the gauges: an Ornstein-Uhlenbeck process of 0.5 s."""
    kept = np.exp(-np.diff(t, prepend=t[0]) / 0.5)
    found, now = np.empty(len(t)), size * rng.normal()
    for i in range(len(t)):
        now = kept[i] * now + size * np.sqrt(1 - kept[i] ** 2) * rng.normal()
        found[i] = now
    return found


# --- unexplained part of a cause


def seen_without_noise(cell: Cell, planned: Planned) -> Array:
    """All readings as one column (n,) mm: gauges, target positions, or positions of the pointer's ball."""
    found = []
    for _, test, _, motion in planned:
        deviation = cell.deviation(motion).take(motion.rows)
        if cell.test == "circle":
            found.append(true_gauges(cell, test, motion, deviation).ravel())
        else:
            found.append(true_points(cell, motion.q_read, deviation).ravel())
    return np.concatenate(found)


@dataclass(frozen=True)
class Sight:
    """Readings that constants and set-up of a cell can imitate: an orthonormal basis (n, p)."""

    cell: Cell
    planned: Planned
    without: Array
    basis: Array
    healthy_um: float
    """Rms of the other errors of the arm after fitting the set-up."""

    def with_cause(self, cause: Cause) -> Cell:
        """Cell with a cause, its rms, and its residual after fitting constants and set-up."""
        cell = replace(self.cell, cause=cause)
        change = seen_without_noise(cell, self.planned) - self.without
        cause_um, foreign_um = rms_um(change - change.mean()), rms_um(remainder(self.basis, change))
        return replace(cell, cause_um=cause_um, foreign_um=foreign_um, healthy_um=self.healthy_um)


def sight_of(cell: Cell) -> Sight:
    """Readings that constants and set-up of a sound cell can imitate."""
    planned = motions(cell)
    sound = seen_without_noise(cell, planned)
    perfect = seen_without_noise(replace(cell, known=no_known(cell.nominal.axes)), planned)
    by_setup = _by_setup(cell, planned)
    healthy = remainder(orth(by_setup, 1e-9), sound - perfect)
    basis = orth(np.concatenate([_by_constants(cell, planned), by_setup], axis=1), 1e-9)
    return Sight(cell, planned, sound, basis, rms_um(healthy))


def remainder(basis: Array, x: Array) -> Array:
    """Remove the part of x (n,) in the span of an orthonormal basis (n, p)."""
    return x - basis @ (basis.T @ x)


def rms_um(x: Array) -> float:
    return 1e3 * float(np.sqrt(np.mean(x**2)))


def _by_constants(cell: Cell, planned: Planned) -> Array:
    """Derivatives (n, p) of all readings by the constants of the arm."""
    changed = []
    for name, step in zip(CONSTANTS, (0.01, 1e-5, 0.01, 1e-5), strict=True):
        for k in range(cell.nominal.axes):
            constants = getattr(cell.known, name).copy()
            constants[k] += step
            changed.append(replace(cell, known=replace(cell.known, **{name: constants})))
    return _derivatives(cell, changed, planned)


def _by_setup(cell: Cell, planned: Planned) -> Array:
    """Derivatives (n, p) of all readings by the fitted parameters of the set-up."""
    changed = []
    for k in range(3):
        step, twist = 0.01 * np.eye(3)[k], np.zeros((2, 6))
        twist[0, k], twist[1, 3 + k] = 0.01, 1e-5
        changed += [replace(cell, frame=T @ cell.frame) for T in small_motion(twist)]
        if cell.test != "circle":
            changed.append(replace(cell, target=cell.target + step))
    return np.concatenate([_derivatives(cell, changed, planned), _by_run(cell, planned)], axis=1)


def _derivatives(cell: Cell, changed: Sequence[Cell], planned: Planned) -> Array:
    """Normalised change (n, p) of all readings for each small change, omitting changes without effect."""
    begin = seen_without_noise(cell, planned)
    found = np.stack([seen_without_noise(one, planned) - begin for one in changed], axis=1)
    sizes = np.linalg.norm(found, axis=0)
    return np.asarray(found[:, sizes > 1e-7] / sizes[sizes > 1e-7])


def _by_run(cell: Cell, planned: Planned) -> Array:
    """Possible shifts (n, p) by each socket, or by the set-up of each ball link test."""
    if cell.test == "touch":
        return np.kron(np.equal.outer(np.arange(TOUCHES) % 2, (0, 1)), np.eye(3))
    if cell.test == "pose":
        return np.zeros((3 * len(planned[0][3].rows), 0))
    readings = [
        (test, gauge)
        for _, test, _, motion in planned
        for _ in motion.rows
        for gauge in range(1 if test == "radial" else 2)
    ]
    of_test, of_gauge = (np.array(part) for part in zip(*readings, strict=True))
    moved = [replace(cell, link=replace(cell.link, ball=cell.link.ball + step)) for step in 0.01 * np.eye(3)]
    shifts = np.concatenate([np.equal.outer(of_gauge, (0, 1)), _derivatives(cell, moved, planned)], axis=1)
    return np.concatenate([shifts * (of_test == test)[:, None] for test in dict.fromkeys(of_test.tolist())], axis=1)


# --- drawing


def draw_noise(rng: np.random.Generator, test: str) -> Noise:
    """Draw the noise of a set-up: tracker 10 to 25 µm (Leica AT960: 15 µm + 6 µm/m), gauges 0.5 to 2 µm, stops of a
    light arm 10 to 25 µm (a third to a half of 50 µm repeatability), sockets 5 to 15 µm."""
    reading = {"pose": (0.010, 0.025), "touch": (0.005, 0.015), "circle": (0.0005, 0.002)}[test]
    return Noise(
        reading_mm=log_uniform(rng, *reading),
        wander_mm=log_uniform(rng, 0.0005, 0.002),
        stop_mm=log_uniform(rng, 0.008, 0.020),
        joint_rad=np.radians(log_uniform(rng, 0.0003, 0.001)),
    )


def places_of(kind: type[Cause]) -> list[tuple[str, str]]:
    """Arms and set-ups in which a cause is visible."""
    every = [("ur10e", "pose"), ("elbow", "pose"), ("seven", "pose"), ("ur10e", "touch"), ("ur10e", "circle")]
    return [place for place in every if place[1] in kind.tests]


def draw_cell(seed: int, kinds: Sequence[type[Cause]] = CAUSES) -> Cell:
    """Draw the cell for a seed. Kinds alternate, and so do the set-ups of a kind. The cause is visible in the runs."""
    rng = np.random.default_rng([seed, 0])
    kind = kinds[seed % len(kinds)]
    places = places_of(kind)
    first = seed // len(kinds) % len(places)
    for arm_name, test in places[first:] + places[:first]:
        found = _with_cause(draw_sound(seed, arm_name, test, rng), kind, rng)
        if found is not None:
            return found
    raise UnreachableError(f"{kind.kind}: no draw can be seen")


def draw_sound(seed: int, arm_name: str, test: str, rng: np.random.Generator) -> Cell:
    """Draw a cell without an unknown cause."""
    axes = nominal_arm(arm_name, test).axes
    turn, way = rng.normal(size=3), rng.uniform(-1, 1, 3)
    frame = small_motion(np.concatenate([2000 * way, turn])[None])[0]
    # The tracker target and the pointer's ball are fitted to the readings; the tool of the ball link is that of the rig
    # file.
    target = {
        "pose": rng.uniform(-60, 60, 3) + np.array([0.0, 0.0, 80.0]),
        "touch": rng.normal(0, 0.3, 3),
        "circle": np.zeros(3),
    }[test]
    return Cell(
        arm_name=arm_name,
        test=test,
        known=draw_known(rng, axes, rich=bool(rng.random() < 0.5)),
        cause=None,
        noise=draw_noise(rng, test),
        seed=seed,
        link=Link(ball=rng.normal(0, 0.4, 3), zeros=rng.normal(0, 0.02, 2)),
        target=target,
        frame=frame if test == "pose" else np.eye(4),
    )


def noise_um(cell: Cell) -> float:
    """Noise of one reading, µm."""
    gauges = np.hypot(cell.noise.reading_mm, cell.noise.wander_mm)
    stops_mm = np.hypot(cell.noise.reading_mm, cell.noise.stop_mm)
    return 1e3 * float(gauges if cell.test == "circle" else stops_mm)


def _with_cause(cell: Cell, kind: type[Cause], rng: np.random.Generator) -> Cell | None:
    """Draw the cause until it is visible; None if no draw is."""
    sight = sight_of(cell)
    for _ in range(MOST_TRIES):
        cause = kind.draw(rng, cell.nominal)
        if isinstance(cause, ToolSlip):
            cause = replace(cause, span_s=float(sight.planned[-1][3].t[-1]))
        found = sight.with_cause(cause)
        if found.foreign_um >= max(
            LEAST_NOISES * noise_um(cell), LEAST_OF_ITSELF * found.cause_um, LEAST_OF_OTHERS * sight.healthy_um
        ):
            return found
    return None


# --- an unseen place


def elsewhere(cell: Cell) -> Motion:
    """Return poses not visited by any run: near the work area with the ball or the sockets, otherwise over the full
    ranges.

    They are visited after all runs, with the latest state of time-dependent causes.
    """
    rng = np.random.default_rng([cell.seed, 3])
    arm, begin_s = cell.nominal, float(motions(cell)[-1][3].t[-1]) + RUN_APART_S
    if cell.test == "pose":
        return stops(draw_postures(arm, ELSEWHERE, rng), begin_s)
    centre = Circle().centre if cell.test == "circle" else (SOCKETS["A"] + SOCKETS["B"]) / 2
    places = centre + rng.uniform(-150.0, 150.0, (ELSEWHERE, 3))
    if cell.test == "touch":
        return stops(touch_postures(arm, places, rng), begin_s)
    (path, _), _ = ball_paths()
    q = []
    for place in places:
        start = path[rng.integers(len(path))]
        T = forward(arm, start[None]).flange @ TOOL
        T = T @ small_motion(np.concatenate([np.zeros(3), rng.uniform(-0.35, 0.35, 3)])[None])
        T[0, :3, 3] = place
        q.append(inverse(arm, T, TOOL, start[None])[0])
    return stops(np.array(q), begin_s)


def points_elsewhere(cell: Cell, motion: Motion) -> Array:
    """True tool positions (n, 3) mm at the stops, in the base frame."""
    deviation = cell.deviation(motion).take(motion.rows)
    return point(forward(cell.arm, motion.q_read, deviation).flange, tool_point(cell) + deviation.tool)


def tool_point(cell: Cell) -> Array:
    """Tool's point (3,) in the flange frame."""
    start = {"pose": np.zeros(3), "touch": BALL_MM, "circle": TOOL[:3, 3]}[cell.test]
    return np.asarray(start + cell.target)


LAP_S = 2 * np.pi * Circle().radius / SPEED_MM_S
