"""What the instruments read when the robot reports what it reported: the forward model behind everything.

    reported angles, in order of time  →  effects  →  readings

The same function predicts for simulated programs and for measured tables, so that a difference between the two is
in the model and not in the method.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.geometry.ball_link import readings
from analysis.geometry.circle import frame_of
from analysis.geometry.hemisphere import hemisphere_frame, target_angles
from analysis.geometry.programs import beside, circle_of, hemisphere_of, repeatability_of
from analysis.kinematics.arm import Arm, Array, Integers, arm_of, forward
from analysis.model.gravity import Load, load_of
from analysis.model.hysteresis import Motion
from analysis.model.scene import Scene, apply
from analysis.traces.tables import CircleTable, PlaceTable, RepeatabilityTable, Table, TouchTable
from rigs.effects import Effect
from rigs.rig import Rig
from rigs.schema.scene import STAGES

_NOTHING = np.empty(0)
_VISIT_S = 4.0
"""The time from one target to the next, where a table has no time."""


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

    @property
    def t_s(self) -> Array:
        """Times (n,) s."""
        return self.motion.t_s

    @property
    def q(self) -> Array:
        """Reported angles (n, axes) rad."""
        return self.motion.q


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


def nominal_setup(rig: Rig, table: Table) -> SetUp:
    """Ball in the nominal centre, gauges at zero, instrument in the world's frame."""
    if isinstance(table, CircleTable):
        ball = np.array(circle_of(rig).centre_mm)
    elif isinstance(table, PlaceTable):
        ball = np.zeros(3)
    else:
        ball = np.array(hemisphere_of(rig).centre_mm)
    gauges = 2 if isinstance(table, CircleTable) else 1
    target = np.eye(4)
    if isinstance(table, TouchTable) and rig.tests.touch:
        target[:3, 3] = rig.tests.touch.ball_mm
    return SetUp(ball, np.zeros(gauges), np.eye(4), target)


def path_of(model: Model, table: Table) -> Path:
    """The motion behind a table: as recorded, or with the approaches that the test prescribes."""
    if isinstance(table, CircleTable):
        return Path(Motion(table.t_s, table.q), np.arange(len(table.q)))
    t_s = np.zeros(len(table.q)) if isinstance(table, PlaceTable) else table.t_s
    came_from = _came_from(model, table) if isinstance(table, RepeatabilityTable | TouchTable) else None
    steady = len(t_s) < 2 or np.diff(t_s).min() <= 0
    t = _VISIT_S * np.arange(1.0, len(table.q) + 1) if steady else t_s
    beat = _VISIT_S if len(t) < 2 else float(np.diff(t).min())
    places = [table.q] * 3 if came_from is None else [came_from, table.q, table.q, table.q]
    times = np.array([-0.3, 0.0, 0.3] if came_from is None else [-0.5, -0.3, 0.0, 0.3]) * beat
    count = len(places)
    path_t = (t[:, None] + times).ravel()
    path_q = np.stack(places, axis=1).reshape(-1, table.q.shape[1])
    return Path(Motion(path_t, path_q), count * np.arange(len(table.q)) + count - 2, stands=True)


def _came_from(model: Model, table: RepeatabilityTable | TouchTable) -> Array | None:
    """Where the joints were (m, axes) before each reading; of targets outside, inside, or at the target where this is
    unknown."""
    if isinstance(table, TouchTable):
        return table.came_from
    frame = hemisphere_frame(hemisphere_of(model.rig))
    polar, azimuth = target_angles(hemisphere_of(model.rig))
    radius = frame.direction(polar[table.target - 1], azimuth[table.target - 1])
    side = np.select([table.approach == "out", table.approach == "in"], [1.0, -1.0], 0.0)
    return beside(model.arm, table.q, (side * repeatability_of(model.rig).approach_mm)[:, None] * radius)


def predict(model: Model, table: Table, path: Path, setup: SetUp) -> Array:
    """Readings (m, k) of a table: gauges in mm; for poses the target's T_instrument_target, (m, 16) row by row."""
    return read(model, table, path, moved(model, path), setup)


def read(model: Model, table: Table, path: Path, scene: Scene, setup: SetUp) -> Array:
    """Readings (m, k) as `predict` gives them, in mm, from a scene that was computed before: nothing that a set-up
    changes moves the tool."""
    if isinstance(table, PlaceTable):
        T = setup.T_instrument_world @ scene.T[path.rows] @ setup.T_tool_target
        return T.reshape(-1, 16)
    to_tool = scene.T[:, :3, 3] - setup.ball
    if isinstance(table, CircleTable):
        circle = frame_of(circle_of(model.rig))
        offsets = np.array([gauge.offset_mm for _, gauge in model.rig.gauges])
        contact = np.arctan2(to_tool @ circle.v, to_tool @ circle.u)
        scene = apply(model.effects, "setup", replace(scene, contact=contact, offsets_mm=offsets))
        g_mm = readings(scene.T, setup.ball, scene.offsets_mm, table.test, circle.radius, scene.form_mm)
    else:
        sphere = hemisphere_frame(hemisphere_of(model.rig))
        contact = np.arctan2(to_tool @ sphere.v, to_tool @ sphere.u)
        scene = apply(model.effects, "setup", replace(scene, contact=contact))
        g_mm = (np.linalg.norm(to_tool, axis=1) - sphere.radius + scene.form_mm)[:, None]
    scene = apply(model.effects, "gauge", replace(scene, g_mm=g_mm - setup.zeros_mm))
    return scene.g_mm if path.alone else scene.g_mm[path.rows]


def moved(model: Model, path: Path) -> Scene:
    """The scene up to where the tool is."""
    return posed(model, path, driven(model, path))


def posed(model: Model, path: Path, scene: Scene) -> Scene:
    """The scene up to where the tool is, from one up to where the joints are."""
    if path.alone:
        motion = Motion(scene.motion.t_s[path.rows], scene.motion.q[path.rows])
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
