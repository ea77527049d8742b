"""Linearisation of readings about the arm and set-ups of a reference, by constants, set-ups and causes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.diagnosis.evidence.observation import ObservedRun, part, predicted
from analysis.diagnosis.evidence.setups import columns_of, moved_setup, placement_of, target_of
from analysis.movement.causes import Cause
from analysis.movement.evidence import LinearReadings, Shift
from analysis.robot.geometry.pose_setup import frame
from analysis.robot.kinematics.arm import Arm, Array, Mask, drive_angles, forward, rotation
from analysis.robot.predict import Model, SetUp, SetUps, pull
from analysis.runs.noise.cell_noise import BALL_MM, JOINT_DEG, SLOW_MM

_ZERO, _LENGTH_MM, _TWIST = float(np.radians(0.05)), 0.2, float(np.radians(0.02))
_CURVE = float(np.radians(0.012))
_DEFLECTION = float(np.radians(3e-4))
"""Prior standard deviations of zeros, lengths, twists, sine terms of the joint error over the angle (rad), and
deflection under gravity (rad/Nm). Chosen: identified industrial arms (UR10, KR240), and strain-wave gears with an
accuracy of about an arc minute. A common factor is estimated.
"""
_FIELDS = (("offset", _ZERO), ("a", _LENGTH_MM), ("d", _LENGTH_MM), ("alpha", _TWIST), ("beta", _TWIST))
_STEP = 1e-3
"""Step of a finite difference as a share of the prior standard deviation."""
_ORDERS = (1, 2, 3, 4, 5, 6)
"""Orders of the sine terms of the joint error over the angle; the prior width decreases with the order."""
_PLACE_MM, _BALL_MM = 30.0, 5.0
"""Prior standard deviations of the set-up terms about the fitted values: wide enough to have no influence."""
_GAUGE_ZERO_MM = 1.0
"""Prior standard deviation of the change of a gauge zero between days: gauges are zeroed again."""
_MOST_READINGS = 150
"""Maximum number of readings of a reference: more take time and add little."""
_CIRCLE_ROWS = 48
"""Number of readings of a circle. Chosen: causes change slowly along it, and neighbours share their noise."""


@dataclass(frozen=True)
class Workplace:
    """Arm, set-ups by name, and centre of the work (3,) mm at which readings are linearised. constants (a,): of the arm
    relative to the rig file, in prior standard deviations.
    """

    model: Model
    setups: SetUps
    centre_mm: Array
    names: Mapping[str, list[int]]
    constants: Array


def selected(runs: Sequence[ObservedRun]) -> list[ObservedRun]:
    """Reduce runs to evenly selected readings for inference."""
    total = sum(len(run.rows) for run in runs if run.facts.of_places)
    chosen = []
    for run in runs:
        most = max(6, int(_MOST_READINGS * len(run.rows) / max(total, 1)))
        kept = part(run, evenly(len(run.rows), most if run.facts.of_places else _CIRCLE_ROWS))
        path = replace(kept.path, rows=kept.samples, alone=True)  # simulated at these readings only
        chosen.append(replace(kept, path=path, rows=np.arange(len(kept.rows)), sampling=None))
    return chosen


def evenly(count: int, most: int) -> Mask:
    """Mask (count,) of at most `most` evenly spaced values."""
    keep = np.zeros(count, dtype=bool)
    keep[np.unique(np.linspace(0, count - 1, min(most, count)).astype(int))] = True
    return keep


# Predictions of a run with a changed arm or set-up.


def _with_arm(run: ObservedRun, arm: Arm, setup: SetUp) -> Array:
    return predicted(replace(run, model=replace(run.model, arm=arm)), setup).ravel()


def angles_of(run: ObservedRun) -> Array:
    return run.path.q[run.samples][:, : run.model.arm.axes]


def tool_places(run: ObservedRun, setup: SetUp) -> Array:
    """Places (m, 3) mm of the ball or target in the world frame at the readings of a run."""
    T = forward(run.model.arm, run.path.q[run.samples])
    return T[:, :3, 3] + T[:, :3, :3] @ setup.T_tool_target[:3, 3]


def _motion(centre_mm: Array, change: Array) -> Array:
    R = rotation(change[3:])
    return frame(R, centre_mm + change[:3] - R @ centre_mm)


def with_cause(arm: Arm, cause: Cause, centre_mm: Array, change: Array) -> Arm:
    """The arm after a movement of base, tool or zero by a change (m,) mm and rad."""
    if cause.what == "base":
        return replace(arm, T_world_base=_motion(centre_mm, change) @ arm.T_world_base)
    if cause.what == "tool":
        return replace(arm, T_flange_tool=arm.T_flange_tool @ frame(np.eye(3), change))
    if cause.what == "zero" and cause.axis:
        return replace(arm, offset=arm.offset + arm.by_drives.coupling[:, cause.axis - 1] * change[0])
    return arm


def after(run: ObservedRun, place: Workplace, cause: Cause, change: Array) -> Array:
    """Predicted readings (n,) mm of a run after a change (m,) mm and rad of a cause."""
    setup, arm = place.setups[run.setup], run.model.arm
    for member in cause.members or (cause,):
        count = len(member.scale)
        own, change = change[:count], change[count:]
        if member.what in ("base", "tool", "zero"):
            arm = with_cause(arm, member, place.centre_mm, own)
        elif _concerns(member, run):
            setup = _moved_thing(setup, member, place.centre_mm, own)
    return _with_arm(run, arm, setup)


def _concerns(cause: Cause, run: ObservedRun) -> bool:
    """Whether a run uses the socket, target or instrument of a cause."""
    if cause.what == "instrument":
        return run.facts.of_tracker and placement_of(run.setup) == cause.name
    if cause.what == "target" and run.facts.of_tracker:
        return target_of(run.setup) == cause.name
    return cause.what in ("socket", "target") and not run.facts.of_tracker and run.setup == cause.name


def _moved_thing(setup: SetUp, cause: Cause, centre_mm: Array, change: Array) -> SetUp:
    if cause.what == "socket":  # the frame of touches contains the negative socket position
        T = setup.T_instrument_world.copy()
        T[:3, 3] -= change
        return replace(setup, T_instrument_world=T)
    if cause.what == "instrument":
        moved = _motion(centre_mm, change)
        return replace(setup, T_instrument_world=setup.T_instrument_world @ np.linalg.inv(moved))
    if setup.T_tool_target[:3, 3].any() or cause.name.isdigit():
        T = setup.T_tool_target.copy()
        T[:3, 3] += change
        return replace(setup, T_tool_target=T)
    return replace(setup, ball=setup.ball + change)


def causes_of(runs: Sequence[ObservedRun]) -> list[Cause]:
    axes = runs[0].model.arm.axes
    sockets = sorted({run.setup for run in runs if run.facts.of_places and not run.facts.of_tracker})
    balls = sorted({run.setup for run in runs if not run.facts.of_places})
    trackers = sorted({placement_of(run.setup) for run in runs if run.facts.of_tracker})
    targets = sorted({target_of(run.setup) for run in runs if run.facts.of_tracker})
    causes = [Cause("base"), Cause("tool"), *(Cause("zero", axis) for axis in range(1, axes + 1))]
    causes += [Cause("socket", name=name) for name in sockets] + [Cause("target", name=name) for name in balls]
    if len(trackers) > 1 or sockets or balls:
        causes += [Cause("instrument", name=name) for name in trackers]
    return causes + [Cause("target", name=name) for name in targets if len(targets) > 1]


# Columns.


def workplace(model: Model, runs: Sequence[ObservedRun], setups: SetUps, constants: Array) -> Workplace:
    places = np.concatenate([tool_places(run, setups[run.setup]) for run in runs])
    return Workplace(model, setups, places.mean(axis=0), columns_of({run.setup: run.table for run in runs}), constants)


def linearise(runs: Sequence[ObservedRun], place: Workplace) -> LinearReadings:
    count, first_rows = 1 + max(map(max, place.names.values())), np.cumsum([0, *(len(run.rows) for run in runs)])
    return LinearReadings.together(
        [_linear(run, place, count, row) for run, row in zip(runs, first_rows.tolist(), strict=False)]
    )


def _linear(run: ObservedRun, place: Workplace, terms: int, first_row: int) -> LinearReadings:
    setup, arm = place.setups[run.setup], run.model.arm
    base = _with_arm(run, arm, setup)
    width = run.values.shape[1]
    columns = _slopes(lambda change: _with_arm(run, _with_constants(arm, change), setup), base, _constant_sds(arm))
    zeros = columns[:, : arm.axes] / _ZERO
    # Prior errors of the drives: waves of the angle, and deflection under gravity, each at one standard deviation.
    q = drive_angles(arm, angles_of(run))
    curves = [_CURVE / order * f(order * q) for order in _ORDERS for f in (np.sin, np.cos)]
    torque = pull(arm, run.model.load, run.path.q[run.samples]).torque
    shapes = np.repeat(np.stack([*curves, _DEFLECTION * torque], axis=2), width, axis=0)
    by_joint = (zeros[:, :, None] * shapes).reshape(len(base), -1)
    arm_columns = np.concatenate([columns, by_joint], axis=1)
    own = np.zeros((len(base), terms))
    facts = run.facts
    width_mm, first_channel = (_PLACE_MM, 0) if facts.of_places else (_BALL_MM, 3)
    steps = np.full(facts.setup_terms, width_mm)
    own[:, place.names[run.setup]] = _slopes(
        lambda change: _with_arm(run, arm, moved_setup(setup, run.table, change)), base, steps
    )
    return LinearReadings(
        run.values.ravel() - base + columns @ place.constants[: columns.shape[1]], arm_columns, own,
        np.repeat(angles_of(run), width, axis=0), np.tile(np.arange(width), len(run.rows)) + first_channel,
        np.repeat(first_row + np.arange(len(run.rows)), width), np.full(len(base), scatter_mm(run)),
    )  # fmt: skip


def scatter_mm(run: ObservedRun) -> float:
    facts = run.facts
    return facts.assumed_sd_mm if facts.of_places else SLOW_MM.rms


def _slopes(predict: Callable[[Array], Array], base: Array, sizes: Array) -> Array:
    """Change (n, m) of a prediction (n,) for each of the sizes (m,), by finite differences."""
    steps = _STEP * np.diag(sizes)
    return np.stack([(predict(step) - base) / _STEP for step in steps], axis=1)


def _constant_sds(arm: Arm) -> Array:
    return np.concatenate([np.full(arm.axes, sd) for _, sd in _FIELDS])


def _with_constants(arm: Arm, change: Array) -> Arm:
    """The arm with its constants changed by (5 axes,) mm and rad. Zeros are those of the drives."""
    parts = dict(zip((name for name, _ in _FIELDS), change.reshape(len(_FIELDS), arm.axes), strict=True))
    parts["offset"] = arm.by_drives.coupling @ parts["offset"]
    return replace(arm, **{name: getattr(arm, name) + part for name, part in parts.items()})


def constants_count(arm: Arm) -> int:
    """Count the columns of kinematic constants, behind which those of joint curves begin."""
    return len(_FIELDS) * arm.axes


def corrected_arm(arm: Arm, times: Array) -> Arm:
    sds = _constant_sds(arm)
    return _with_constants(arm, sds * times[: len(sds)])


def day_columns(runs: Sequence[ObservedRun], readings: LinearReadings) -> Array:
    """Effect (n, d) mm on new readings of a standard deviation of each usual change between days: joint positions, the
    place of ball or base, and gauge zeros.
    """
    axes = readings.angles.shape[1]
    day = readings.arm[:, :axes] / _ZERO * np.radians(JOINT_DEG.middle)
    shift = np.stack([(readings.channel == k) * BALL_MM.middle for k in range(3)], axis=1)
    gauges, first = [], 0
    for run in runs:
        stop = first + run.values.size
        if not run.facts.of_places:
            for channel in range(run.values.shape[1]):
                column = np.zeros(len(readings.residual))
                column[first + channel : stop : run.values.shape[1]] = _GAUGE_ZERO_MM
                gauges.append(column)
        first = stop
    return np.column_stack([day, shift, *gauges])


def shift_of(runs: Sequence[ObservedRun], place: Workplace, cause: Cause, about: Array | None = None) -> Shift:
    """Effect of a cause on the readings of runs, linearised about a change (m,) mm and rad."""
    about = np.zeros(len(cause.scale)) if about is None else about

    def predict(change: Array) -> Array:
        return np.concatenate([after(run, place, cause, change) for run in runs])

    base = predict(about)
    columns = _slopes(lambda step: predict(about + step), base, cause.scale) / cause.scale
    unmoved = predict(np.zeros_like(about)) if about.any() else base
    return Shift(columns, columns @ about - (base - unmoved))
