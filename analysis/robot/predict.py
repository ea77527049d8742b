"""Prediction of instrument readings from reported joint angles: the forward model used everywhere.

reported angles, in order of time  →  effects  →  readings

The same function serves simulated programs and measured tables. A difference between the two is therefore due to the
model, not to the method.

The effects change a scene (`rigs/schema/scene.py`): motion with joint reversals, on which hysteresis depends, an arm
with loads, and gravity on joints and base.

The geometric part of a model is an arm: joint zeros and link constants are valid in all postures, so any program for
rigid arms can use them completely. Compliance, waves, backlash, growth and lag are not included.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import islice

import numpy as np

from analysis.robot.kinematics.arm import (
    RAIL_MM,
    Arm,
    Array,
    Integers,
    arm_of,
    base_places,
    blocks,
    drive_angles,
    forward,
    link_columns,
    rail_frame,
    rail_mm,
    rotation,
)
from rigs.effects import Effect
from rigs.rig import Rig
from rigs.schema.effect import Payload
from rigs.schema.robot import Robot
from rigs.schema.scene import STAGES, Stage, play

_TURN_RAD = np.radians(0.003)
"""Smaller changes are encoder noise, not reversals."""
_STANDSTILL_S = 0.1
"""Window for a standstill: the robot is at rest if all joints turn by less than encoder noise within this time.
Every program is faster."""
_INSTANT_S = 1e-6
"""Rounding error of a time."""
_NEAR_S = 0.25
_LEAST = 5
_NONE: Integers = np.empty(0, dtype=np.intp)


@dataclass(frozen=True, eq=False)
class Motion:
    """Reported angles q (n, axes) rad at times t_s (n,).

    samples_per_visit: 0 for a single trace in order of time. Otherwise every group of this size is a separate visit:
    the time between visits and their order are unknown.
    """

    t_s: Array
    q: Array
    samples_per_visit: int = 0
    _reversals: dict[int, list[tuple[float, float]]] = field(default_factory=dict, init=False, repr=False)
    _of_drives: dict[bytes, Motion] = field(default_factory=dict, init=False, repr=False)

    def of_drives(self, arm: Arm) -> Motion:
        """Motion of the drives of an arm, with their angles and reversals."""
        if arm.drives is None:
            return self
        key = arm.to_drives.tobytes()
        if key not in self._of_drives:
            self._of_drives[key] = replace(self, q=drive_angles(arm, self.q))
        return self._of_drives[key]

    def reversals(self, axis: int) -> list[tuple[float, float]]:
        if self.samples_per_visit:
            return []
        if axis not in self._reversals:
            self._reversals[axis] = turns(self.t_s, self.q[:, axis - 1], self._stand_ends)
        return self._reversals[axis]

    @cached_property
    def _stand_ends(self) -> Integers:
        ends = [end - 1 for _, end in standing(self.t_s, self.q, _TURN_RAD, _STANDSTILL_S) if end < len(self.t_s)]
        return np.array(ends, dtype=np.intp)


def standing(t_s: Array, q: Array, still_rad: float, window_s: float) -> list[tuple[int, int]]:
    """Rows [begin, end) of each standstill: all joints move by less than still_rad within window_s."""
    rows = np.arange(len(t_s))
    ahead = np.searchsorted(t_s, t_s + window_s - _INSTANT_S).clip(max=len(t_s) - 1)
    # A robot that reverses with no stop returns to the same position, but moves in between.
    moved = np.maximum(np.abs(q[ahead] - q), np.abs(q[(rows + ahead) // 2] - q)).max(axis=1)
    still = (moved < still_rad) & (t_s[ahead] - t_s >= 0.9 * window_s)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(int), [0]])))
    periods: list[tuple[int, int]] = []
    for begin, last in edges.reshape(-1, 2).tolist():
        end = int(ahead[last - 1]) + 1
        if periods and begin < periods[-1][1]:
            periods[-1] = (periods[-1][0], end)
        else:
            periods.append((begin, end))
    return periods


def turns(t_s: Array, x: Array, stand_ends: Integers = _NONE) -> list[tuple[float, float]]:
    """Reversals of x (n,) rad: time in s, and new direction (±1).

    stand_ends (s,): last row of each standstill. A reversal in a standstill happens at the departure, otherwise at the
    vertex of the motion.
    """
    follower = play(x, _TURN_RAD / 2)
    moving = np.flatnonzero(np.diff(follower))
    direction = np.sign(np.diff(follower)[moving])
    changes = np.append(np.flatnonzero(np.diff(x)), len(x) - 1)
    reversals = []
    for k in np.flatnonzero(np.diff(direction)):
        # The follower resumes only after the gap; the reversal itself was at the previous extreme.
        between = slice(moving[k], moving[k + 1] + 1)
        extreme = moving[k] + int(np.argmin(direction[k + 1] * x[between]))
        last = int(changes[np.searchsorted(changes, extreme)])
        # A joint may rest after the departure of the robot while other joints turn.
        leaves = np.searchsorted(t_s, t_s[moving[k + 1]] - 2 * _NEAR_S)
        ended = stand_ends[(stand_ends >= max(moving[k], leaves)) & (stand_ends <= moving[k + 1] + 1)]
        if len(ended):
            when = t_s[ended[-1]]
        elif len(_near(t_s, extreme)) < _LEAST:
            when = t_s[last]  # At a program stop the joint reverses at the departure.
        else:
            # Between samples: the vertex of a parabola through the samples around the extreme, which rounding may
            # flatten. If there is no parabola, as around a stop, the extreme itself is sufficient.
            middle = (extreme + last) // 2
            near = _near(t_s, middle)
            since = t_s[near] - t_s[middle]
            bend, slope, _ = np.polyfit(since, x[near] - x[middle], 2)
            shift = -slope / (2 * bend) if bend else np.inf
            when = t_s[middle] + shift if abs(shift) <= 2 * np.max(np.diff(since)) else t_s[middle]
        reversals.append((float(when), float(direction[k + 1])))
    return reversals


def _near(t_s: Array, k: int) -> Integers:
    first, end = np.searchsorted(t_s, t_s[k] + 2 * _NEAR_S * np.array([-1, 1]))
    near: Integers = first + np.flatnonzero(np.abs(t_s[first:end] - t_s[k]) <= _NEAR_S)
    return near


_G = 9.80665
"""Standard acceleration of free fall in m/s² (ISO 80000-3), opposite to z of the world."""


@dataclass(frozen=True)
class Load:
    """Link masses. mass (axes,) kg of each link, centre (axes, 3) mm in the frame of the link, payload_kg at the
    flange."""

    mass: Array
    centre: Array
    payload_kg: float

    @property
    def payload(self) -> Payload:
        return Payload(self.payload_kg, float(self.mass.sum()))


def load_of(robot: Robot) -> Load:
    mass = np.array([axis.mass_kg for axis in robot.axes])
    return Load(mass, np.array([axis.centre_mm for axis in robot.axes], dtype=float), robot.payload_kg)


@dataclass(frozen=True, eq=False)
class Pull:
    """Gravity at n postures.

    torque (n, axes) Nm on each drive. moment (n, 3) Nm on the base, about its origin and in its axes.
    """

    torque: Array
    moment: Array


_recent: deque[tuple[Arm, Load, Array, Pull]] = deque(maxlen=32)
"""Gravity of recent traces: a fit requests the same few repeatedly. Values are never changed in place."""
_KEPT_ROWS = 50_000
"""Longer traces are not cached: 32 traces would need 150 MB, and a simulation requests each of them once."""


def pull(arm: Arm, load: Load, q: Array) -> Pull:
    for known_arm, known_load, known_q, pulled in _recent:
        if (
            known_q is q
            and known_arm is arm
            and known_load.mass is load.mass
            and known_load.centre is load.centre
            and known_load.payload_kg == load.payload_kg
        ):
            return pulled
    # Masses (axes,) kg and centres (axes, 3) mm including the payload at the flange, the last frame.
    mass, centre = load.mass.copy(), load.centre.copy()
    mass[-1] += load.payload_kg
    if mass[-1] > 0:
        centre[-1] *= load.mass[-1] / mass[-1]
    per_theta, about_base = np.empty((arm.axes, len(q))), np.zeros((3, len(q)))
    for block in blocks(len(q)):
        links = list(link_columns(arm, q[block]))
        beyond_kg, beyond_kg_mm = 0.0, np.zeros((2, links[0].shape[2]))
        for axis in reversed(range(arm.axes)):
            x, y, z, origin = links[axis][:, :2]
            beyond_kg += mass[axis]
            beyond_kg_mm += mass[axis] * (origin + centre[axis, 0] * x + centre[axis, 1] * y + centre[axis, 2] * z)
            across_x, across_y = beyond_kg_mm - beyond_kg * origin
            per_theta[axis, block] = _G * (z[1] * across_x - z[0] * across_y)
        beside_x, beside_y = beyond_kg_mm - beyond_kg * base_places(arm, q[block])[:, :2].T
        about_base[:2, block] = -_G * beside_y, _G * beside_x
    pulled = Pull((arm.by_drives.coupling.T @ per_theta / 1000.0).T, about_base.T @ arm.T_world_base[:3, :3] / 1000.0)
    if len(q) <= _KEPT_ROWS:
        _recent.append((arm, load, q, pulled))
    return pulled


@dataclass(frozen=True)
class ModelScene:
    """A scene with n samples in order of time. Values of later stages are empty.

    Joint angles are those of the drives. motion: as reported. link_q (n, axes) rad. T (n, 4, 4): the tool in the world.
    contact (n,) rad: contact angle of the link around the ball. form_mm (n,): distance added by the form of the ball.
    offsets_mm (k,): gauge positions on the baseline. g_mm (n, k): readings.
    """

    arm: Arm
    load: Load
    motion: Motion
    link_q: Array
    T: Array
    contact: Array
    form_mm: Array
    offsets_mm: Array
    g_mm: Array

    @property
    def t_s(self) -> Array:
        return self.motion.t_s

    @property
    def q(self) -> Array:
        return self.motion.q

    @property
    def samples_per_visit(self) -> int:
        return self.motion.samples_per_visit

    @property
    def base_mm(self) -> Array:
        return self.arm.T_world_base[:3, 3]

    def reported_at(self, t_s: Array) -> Array:
        """Reported angles (n, axes) rad at times t_s (n,), constant beyond the ends.

        Cubic with the slopes of the samples: the error of a linear interpolation exceeds the effect of a lag of a
        millisecond. The slope is zero next to a standstill. In an untimed table the robot rests at each reading.
        """
        t = self.t_s
        if self.samples_per_visit:
            return self.q
        if len(t) == 1:
            return np.repeat(self.q, len(t_s), axis=0)
        k = np.clip(np.searchsorted(t, t_s) - 1, 0, len(t) - 2)
        width = t[k + 1] - t[k]
        x = np.clip((t_s - t[k]) / width, 0.0, 1.0)
        rise, begin, end = x * x * (3 - 2 * x), width * x * (1 - x) ** 2, width * x * x * (1 - x)
        angles = np.empty((len(t_s), self.q.shape[1]))
        for axis, q in enumerate(self.q.T):  # Process the axes in turn, to limit the temporary arrays of a long trace.
            slopes = np.gradient(q, t)
            stands = np.diff(q) == 0
            slopes[:-1][stands] = slopes[1:][stands] = 0.0
            angles[:, axis] = q[k] + rise * (q[k + 1] - q[k]) + begin * slopes[k] - end * slopes[k + 1]
        return angles

    def reversals(self, axis: int) -> list[tuple[float, float]]:
        return self.motion.reversals(axis)

    def torques(self, payload_kg: float = 0.0) -> Array:
        hangs_kg = max(self.load.payload_kg + payload_kg, 0.0)
        return pull(self.arm, replace(self.load, payload_kg=hangs_kg), self.q).torque

    def moment(self) -> Array:
        return pull(self.arm, self.load, self.q).moment

    def link_after(self, axis: int) -> tuple[Array, Array, Array]:
        """Joint position, axis direction and link end (n, 3) in mm; without a length, the end is the joint position."""
        place, direction, end = np.empty((3, len(self.link_q), 3))
        for block in blocks(len(self.link_q)):
            links = list(islice(link_columns(self.arm, self.link_q[block]), axis + 1))
            _, _, direction[block].T[:], place[block].T[:] = links[axis - 1]
            end[block] = links[axis][3].T if axis < self.arm.axes else self.T[block, :3, 3]
        return place, direction, end

    def taken_at(self, t_s: Array) -> ModelScene:
        q = self.reported_at(t_s)
        return replace(self, motion=Motion(self.t_s, q), link_q=q)

    def with_constant(self, field: str, axis: int, delta: float) -> ModelScene:
        """Change an arm constant (a, d in mm; alpha, beta in rad) of an axis (from 1) by delta."""
        column = getattr(self.arm, field).copy()
        column[axis - 1] += delta
        return replace(self, arm=replace(self.arm, **{field: column}))

    def turned(self, axis: int, deviation: Array | float) -> ModelScene:
        """Turn the link side of a joint (from 1) by a deviation (n,) rad."""
        link_q = self.link_q.copy()
        link_q[:, axis - 1] += deviation
        return replace(self, link_q=link_q)

    def along_rail(self, error_mm_m: Array) -> ModelScene:
        """Move the tool by an error (3,) in mm per metre of the rail position: along it, across it horizontally in the
        base frame, and across both.
        """
        if self.arm.rail is None:
            return self
        offset = rail_frame(self.arm) @ error_mm_m / RAIL_MM
        return self.shifted(rail_mm(self.arm, self.q[: len(self.T)])[:, None] * offset)

    def tilted(self, turn: Array, below_mm: float) -> ModelScene:
        """Turn the arm by rotation vectors (n, 3) rad in base axes, about a point below the base origin."""
        R_base = self.arm.T_world_base[:3, :3]
        R = rotation(turn @ R_base.T)
        pivot = base_places(self.arm, self.q[: len(self.T)]) - below_mm * R_base[:, 2]
        T = self.T.copy()
        T[:, :3, :3] = R @ self.T[:, :3, :3]
        T[:, :3, 3] = pivot + np.einsum("nij,nj->ni", R, self.T[:, :3, 3] - pivot)
        return replace(self, T=T)

    def raised(self, height_mm: Array) -> ModelScene:
        return self.shifted(np.outer(height_mm, self.arm.T_world_base[:3, 2]))

    def shifted(self, offset_mm: Array) -> ModelScene:
        T = self.T.copy()
        T[:, :3, 3] += offset_mm
        return replace(self, T=T)

    def with_form(self, form_mm: Array) -> ModelScene:
        return replace(self, form_mm=self.form_mm + form_mm)

    def blended(self, before: ModelScene, after: ModelScene, share: float) -> ModelScene:
        """Keep a share of the change made by a joint or gauge effect."""
        link_q, g_mm = share * (after.link_q - before.link_q), share * (after.g_mm - before.g_mm)
        return replace(self, link_q=self.link_q + link_q, g_mm=self.g_mm + g_mm)

    def with_gauges_at(self, offsets_mm: Array) -> ModelScene:
        return replace(self, offsets_mm=offsets_mm)

    def read(self, gauge: str, change: Callable[[Array], Array]) -> ModelScene:
        """Change the readings (n,) mm of a gauge, if the test uses it."""
        column = {"g1": 0, "g2": 1}[gauge]
        if column >= self.g_mm.shape[1]:
            return self
        g_mm = self.g_mm.copy()
        g_mm[:, column] = change(g_mm[:, column])
        return replace(self, g_mm=g_mm)

    def all_read(self, change: Callable[[Array], Array]) -> ModelScene:
        return replace(self, g_mm=change(self.g_mm))


def apply(effects: Sequence[Effect], stage: Stage, scene: ModelScene) -> ModelScene:
    for effect in effects:
        if stage == effect.STAGE:
            scene = effect.apply(scene)
    return scene


_NOTHING = np.empty(0)
_VISIT_S = 4.0
"""Time between the targets of an untimed table."""
_LONG, _KEPT = 20_000, 4
"""Path length in samples above which scenes are not cached, and number of cached scenes for a shorter path, at most
4 MB each."""


@dataclass(frozen=True)
class Path:
    """Reported motion of a table, including positions between the readings, in rows (m,).

    stands: the robot rested at each reading long enough to make clock differences irrelevant. alone: the tool is
    simulated only at the readings, because later effects have little memory.
    """

    motion: Motion
    rows: Integers
    stands: bool = False
    alone: bool = False
    _scenes: dict[Hashable, tuple[Model, ModelScene]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    @property
    def t_s(self) -> Array:
        return self.motion.t_s

    @property
    def q(self) -> Array:
        return self.motion.q

    def at_readings(self, simulated: Array) -> Array:
        return simulated if self.alone else simulated[self.rows]


@dataclass(frozen=True)
class SetUp:
    """Set-up: estimated in every fit, and not part of a rig file.

    ball (3,) mm in the world. zeros_mm (k,): negative gauge offsets. For pose tables T_instrument_world and
    T_tool_target (4, 4): pose of the instrument, and position of the target on the tool.
    """

    ball: Array
    zeros_mm: Array
    T_instrument_world: Array
    T_tool_target: Array


SetUps = Mapping[str, SetUp]
"""Set-ups by name."""


@dataclass(frozen=True)
class Model:
    """The arm of a rig with loads and effects."""

    rig: Rig
    arm: Arm
    load: Load
    effects: tuple[Effect, ...]


def model_of(rig: Rig, effects: Sequence[Effect] | None = None) -> Model:
    if effects is None:
        effects = (*rig.effects, *(rig.calibrated.effects if rig.calibrated else ()))
    return Model(rig, arm_of(rig.robot), load_of(rig.robot), tuple(effects))


def stops(q: Array, t_s: Array | None = None, came_from: Array | None = None) -> Path:
    """Motion of a robot that stops at each reading, in the given order.

    came_from (n, axes): joint angles in rad before each reading; None if the robot arrives from the previous one.
    """
    t = _VISIT_S * np.arange(1.0, len(q) + 1) if t_s is None or len(t_s) < 2 or np.diff(t_s).min() <= 0 else t_s
    beat = _VISIT_S if len(t) < 2 else float(np.diff(t).min())
    places = [q] * 3 if came_from is None else [came_from, q, q, q]
    times = np.array([-0.3, 0.0, 0.3] if came_from is None else [-0.5, -0.3, 0.0, 0.3]) * beat
    count = len(places)
    path_t = (t[:, None] + times).ravel()
    path_q = np.stack(places, axis=1).reshape(-1, q.shape[1])
    return Path(Motion(path_t, path_q), count * np.arange(len(q)) + count - 2, stands=True)


def visits(q: Array, came_from: Array | None = None) -> Path:
    """Motion of a robot that stops at each reading in an unknown order.

    came_from (n, axes): joint angles in rad before each reading, if known. Each visit has the same times, because the
    table is untimed.
    """
    places = [q, q] if came_from is None else [came_from, q, q]
    samples = len(places)
    t_s = np.tile(_VISIT_S * np.linspace(0.0, 1.0, samples), len(q))
    motion = Motion(t_s, np.stack(places, axis=1).reshape(-1, q.shape[1]), samples)
    return Path(motion, samples * np.arange(len(q)) + samples - 1, stands=True, alone=True)


def gauged(model: Model, path: Path, scene: ModelScene, setup: SetUp, g_mm: Array) -> Array:
    scene = apply(model.effects, "gauge", replace(scene, g_mm=g_mm - setup.zeros_mm))
    return path.at_readings(scene.g_mm)


def moved(model: Model, path: Path) -> ModelScene:
    """Scene up to the tool stage.

    Recent scenes of short paths are cached, because fits and steps of a diagnosis reuse them.
    """
    if len(path.q) > _LONG:
        return posed(model, path, driven(model, path))
    key = (id(model.arm), id(model.load), *(effect.model_copy(update={"found": None}) for effect in model.effects))
    kept = path._scenes.pop(key, None)
    if kept is None or kept[0].arm is not model.arm:  # After copying a path the keys belong to other objects.
        kept = (model, posed(model, path, driven(model, path)))
    path._scenes[key] = kept  # Store the model too, so that the parts keep their identities.
    if len(path._scenes) > _KEPT:
        del path._scenes[next(iter(path._scenes))]
    return kept[1]


def posed(model: Model, path: Path, scene: ModelScene) -> ModelScene:
    if path.alone:
        visit = min(path.motion.samples_per_visit, 1)
        motion = Motion(scene.motion.t_s[path.rows], scene.motion.q[path.rows], visit)
        scene = replace(scene, motion=motion, link_q=scene.link_q[path.rows], form_mm=scene.form_mm[path.rows])
    return apply(model.effects, "tool", replace(scene, T=forward(scene.arm, scene.link_q)))


def driven(model: Model, path: Path) -> ModelScene:
    n, motion = len(path.q), path.motion.of_drives(model.arm)
    scene = ModelScene(
        arm=model.arm.by_drives,
        load=model.load,
        motion=motion,
        link_q=motion.q,
        T=_NOTHING,
        contact=_NOTHING,
        form_mm=np.zeros(n),
        offsets_mm=_NOTHING,
        g_mm=_NOTHING,
    )
    for stage in STAGES[path.stands : STAGES.index("tool")]:
        scene = apply(model.effects, stage, scene)
    return scene


_GEOMETRIC = ("joint zero", "link constant")
"""Kinds of compensation by constants of the arm."""


def is_geometric(effect: Effect) -> bool:
    return effect.compensation().use in _GEOMETRIC


def geometric_part(model: Model) -> Model:
    return replace(model, effects=tuple(effect for effect in model.effects if is_geometric(effect)))


def geometric_arm(model: Model) -> Arm:
    """Arm with all joint zeros and link constants of a model merged into its constants."""
    at_zero = Path(Motion(np.zeros(1), np.zeros((1, model.arm.axes))), np.zeros(1, dtype=np.int64), stands=True)
    scene = driven(geometric_part(model), at_zero)
    turned = scene.arm.coupling @ scene.link_q[0]
    return replace(scene.arm, offset=scene.arm.offset + turned, coupling=model.arm.coupling, drives=model.arm.drives)
