"""What the instruments read when the robot reports what it reported: the forward model behind everything.

    reported angles, in order of time  →  effects  →  readings

The same function predicts for simulated programs and for measured tables, so that a difference between the two is
in the model and not in the method.

Of a model the geometric part is an arm: joint zeros and link constants are the same in all postures, so that an arm
with other constants carries them whole, in any program that knows rigid arms. Compliance, waves, plays, growth and lag
are not in it.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from analysis.robot.kinematics.arm import Arm, Array, Integers, arm_of, forward
from analysis.robot.model.motion import Motion
from analysis.robot.model.scene import Load, Scene, apply, load_of
from rigs.effects import Effect
from rigs.rig import Rig
from rigs.schema.scene import STAGES

_NOTHING = np.empty(0)
_VISIT_S = 4.0
"""The time from one target to the next, where a table has no time."""
_LONG, _KEPT = 20_000, 4
"""Samples of a path from which no scene of it is kept, and how many of a shorter one, at most some 4 MB each."""


@dataclass(frozen=True)
class Path:
    """The reported motion behind a table, with the places passed between its readings.

    motion of n samples; rows (m,): which of them are the table's readings; stands: whether the robot stood at each,
    long enough that it does not matter by which clock; alone: whether the tool is simulated at the readings alone,
    because what follows the joints has little memory.
    """

    motion: Motion
    rows: Integers
    stands: bool = False
    alone: bool = False
    _scenes: dict[Hashable, tuple[Model, Scene]] = field(default_factory=dict, init=False, repr=False, compare=False)

    @property
    def t_s(self) -> Array:
        """Times (n,) s."""
        return self.motion.t_s

    @property
    def q(self) -> Array:
        """Reported angles (n, axes) rad."""
        return self.motion.q

    def at_readings(self, simulated: Array) -> Array:
        """What was simulated of the tool, (n, …) in mm or rad, at the readings (m, …)."""
        return simulated if self.alone else simulated[self.rows]


@dataclass(frozen=True)
class SetUp:
    """What no rig file knows and every fit begins with.

    ball (3,) mm in the world; zeros_mm (k,): what the gauges show too little. For pose tables T_instrument_world and
    T_tool_target (4, 4): where the instrument stands and where its target sits on the tool.
    """

    ball: Array
    zeros_mm: Array
    T_instrument_world: Array
    T_tool_target: Array


@dataclass(frozen=True)
class Model:
    """A rig's arm with its loads and effects."""

    rig: Rig
    arm: Arm
    load: Load
    effects: tuple[Effect, ...]


def model_of(rig: Rig, effects: Sequence[Effect] | None = None) -> Model:
    """The model of a rig, with the effects of its file and of its calibration, or with others instead."""
    if effects is None:
        effects = (*rig.effects, *(rig.calibrated.effects if rig.calibrated else ()))
    return Model(rig, arm_of(rig.robot), load_of(rig.robot), tuple(effects))


def stops(q: Array, t_s: Array | None = None, came_from: Array | None = None) -> Path:
    """The motion of a robot that stands at each reading, in their order, at joints q (n, axes) rad and times t_s (n,) s
    if they are known; came_from (n, axes) rad: where the joints were before, None if each comes from the reading
    before."""
    t = _VISIT_S * np.arange(1.0, len(q) + 1) if t_s is None or len(t_s) < 2 or np.diff(t_s).min() <= 0 else t_s
    beat = _VISIT_S if len(t) < 2 else float(np.diff(t).min())
    places = [q] * 3 if came_from is None else [came_from, q, q, q]
    times = np.array([-0.3, 0.0, 0.3] if came_from is None else [-0.5, -0.3, 0.0, 0.3]) * beat
    count = len(places)
    path_t = (t[:, None] + times).ravel()
    path_q = np.stack(places, axis=1).reshape(-1, q.shape[1])
    return Path(Motion(path_t, path_q), count * np.arange(len(q)) + count - 2, stands=True)


def visits(q: Array, came_from: Array | None = None) -> Path:
    """Return the motion of a robot that stands at joints q (n, axes) rad in an unknown order; came_from (n, axes) rad:
    where each joint was before, None if it is unknown. Each visit has the same times, since the table has none."""
    places = [q, q] if came_from is None else [came_from, q, q]
    samples = len(places)
    t_s = np.tile(_VISIT_S * np.linspace(0.0, 1.0, samples), len(q))
    motion = Motion(t_s, np.stack(places, axis=1).reshape(-1, q.shape[1]), samples)
    return Path(motion, samples * np.arange(len(q)) + samples - 1, stands=True, alone=True)


def gauged(model: Model, path: Path, scene: Scene, setup: SetUp, g_mm: Array) -> Array:
    """Readings (m, k) mm of gauges whose plungers stand at g_mm (n, k) mm, zeros and errors of the gauges with them."""
    scene = apply(model.effects, "gauge", replace(scene, g_mm=g_mm - setup.zeros_mm))
    return path.at_readings(scene.g_mm)


def moved(model: Model, path: Path) -> Scene:
    """The scene up to where the tool is; of a path that is not long the latest ones are kept, since fits, gaps and
    steps of a diagnosis ask for the same."""
    if len(path.q) > _LONG:
        return posed(model, path, driven(model, path))
    key = (id(model.arm), id(model.load), *(effect.model_copy(update={"found": None}) for effect in model.effects))
    kept = path._scenes.pop(key, None)
    if kept is None or kept[0].arm is not model.arm:  # of a path that was copied the keys are of other objects
        kept = (model, posed(model, path, driven(model, path)))
    path._scenes[key] = kept  # the model with it, so that its parts keep their identities
    if len(path._scenes) > _KEPT:
        del path._scenes[next(iter(path._scenes))]
    return kept[1]


def posed(model: Model, path: Path, scene: Scene) -> Scene:
    """The scene up to where the tool is, from one up to where the joints are."""
    if path.alone:
        visit = min(path.motion.samples_per_visit, 1)
        motion = Motion(scene.motion.t_s[path.rows], scene.motion.q[path.rows], visit)
        scene = replace(scene, motion=motion, link_q=scene.link_q[path.rows], form_mm=scene.form_mm[path.rows])
    return apply(model.effects, "tool", replace(scene, T=forward(scene.arm, scene.link_q)))


def driven(model: Model, path: Path) -> Scene:
    """The scene up to where the joints are, at all n samples of a path."""
    n = len(path.q)
    scene = Scene(
        arm=model.arm,
        load=model.load,
        motion=path.motion,
        link_q=path.q,
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
"""The uses of what is a constant of the arm."""


def is_geometric(effect: Effect) -> bool:
    """Return whether an effect only changes constants of the arm."""
    return effect.compensation().use in _GEOMETRIC


def geometric_part(model: Model) -> Model:
    """Return the model without the effects that constants of the arm cannot carry."""
    return replace(model, effects=tuple(effect for effect in model.effects if is_geometric(effect)))


def geometric_arm(model: Model) -> Arm:
    """Return the arm with all joint zeros and link constants of a model's effects in its own constants.

    Reported angles give the same poses with it as with the geometric part of the model.
    """
    at_zero = Path(Motion(np.zeros(1), np.zeros((1, model.arm.axes))), np.zeros(1, dtype=np.int64), stands=True)
    scene = driven(geometric_part(model), at_zero)
    turned = scene.arm.coupling @ scene.link_q[0]
    return replace(scene.arm, offset=scene.arm.offset + turned)
