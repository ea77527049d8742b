"""Prediction of instrument readings from reported joint angles: the forward model used everywhere.

reported angles, in order of time  →  effects  →  readings

The same function serves simulated programs and measured tables. A difference between the two is therefore due to the
model, not to the method.

The geometric part of a model is an arm: joint zeros and link constants are valid in all postures, so any program for
rigid arms can use them completely. Compliance, waves, backlash, growth and lag are not included.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from analysis.robot.kinematics.arm import Arm, Array, Integers, arm_of, forward
from analysis.robot.model.scene import Load, ModelScene, Motion, apply, load_of
from rigs.effects import Effect
from rigs.rig import Rig
from rigs.schema.scene import STAGES

_NOTHING = np.empty(0)
_VISIT_S = 4.0
"""Time between the targets of an untimed table."""
_LONG, _KEPT = 20_000, 4
"""Path length in samples above which scenes are not cached, and number of cached scenes for a shorter path, at most
4 MB each."""


@dataclass(frozen=True)
class Path:
    """Reported motion of a table, including positions between the readings.

    motion: n samples. rows (m,): samples with readings. stands: whether the robot rested at each reading long enough to
    make clock differences irrelevant. alone: whether the tool is simulated only at the readings, because later effects
    have little memory.
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
        """Simulated tool values (n, …) in mm or rad at the readings (m, …)."""
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


@dataclass(frozen=True)
class Model:
    """The arm of a rig with loads and effects."""

    rig: Rig
    arm: Arm
    load: Load
    effects: tuple[Effect, ...]


def model_of(rig: Rig, effects: Sequence[Effect] | None = None) -> Model:
    """Model of a rig, with the effects of its file and calibration or with the given effects."""
    if effects is None:
        effects = (*rig.effects, *(rig.calibrated.effects if rig.calibrated else ()))
    return Model(rig, arm_of(rig.robot), load_of(rig.robot), tuple(effects))


def stops(q: Array, t_s: Array | None = None, came_from: Array | None = None) -> Path:
    """Motion of a robot that stops at each reading, in the given order.

    q (n, axes): joint angles in rad at the readings. t_s (n,): times in s, if known. came_from (n, axes): joint angles
    in rad before each reading; None if the robot arrives from the previous reading.
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

    q (n, axes): joint angles in rad at the readings. came_from (n, axes): joint angles in rad before each reading, None
    if unknown. Each visit has the same times, because the table is untimed.
    """
    places = [q, q] if came_from is None else [came_from, q, q]
    samples = len(places)
    t_s = np.tile(_VISIT_S * np.linspace(0.0, 1.0, samples), len(q))
    motion = Motion(t_s, np.stack(places, axis=1).reshape(-1, q.shape[1]), samples)
    return Path(motion, samples * np.arange(len(q)) + samples - 1, stands=True, alone=True)


def gauged(model: Model, path: Path, scene: ModelScene, setup: SetUp, g_mm: Array) -> Array:
    """Gauge readings (m, k) mm for plunger positions g_mm (n, k) mm, with zeros and gauge errors."""
    scene = apply(model.effects, "gauge", replace(scene, g_mm=g_mm - setup.zeros_mm))
    return path.at_readings(scene.g_mm)


def moved(model: Model, path: Path) -> ModelScene:
    """Scene up to the tool stage.

    Recent scenes of short paths are cached, because fits, gaps and steps of a diagnosis reuse the scenes.
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
    """Scene up to the tool stage, from a scene up to the joint stage."""
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
    """Arm with all joint zeros and link constants of a model merged into the constants.

    It gives the same poses as the geometric part of the model.
    """
    at_zero = Path(Motion(np.zeros(1), np.zeros((1, model.arm.axes))), np.zeros(1, dtype=np.int64), stands=True)
    scene = driven(geometric_part(model), at_zero)
    turned = scene.arm.coupling @ scene.link_q[0]
    return replace(scene.arm, offset=scene.arm.offset + turned, coupling=model.arm.coupling, drives=model.arm.drives)
