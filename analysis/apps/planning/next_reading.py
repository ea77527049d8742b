"""The next reading, and whether it is worth its time: correct, repair, measure more, or do nothing.

The loss of an act is the expected error at the targets after it, plus the price of its minutes. A reading is worth its
time if the loss of the best act falls by more than the reading costs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from analysis.apps.planning.pose_pool import Sight
from analysis.apps.planning.possible_readings import (
    TOUCH_MIN,
    Reading,
    pool_of_readings,
    poses_at,
    possible_readings,
    touches_at,
)
from analysis.apps.planning.reading_pool import ReadingPool
from analysis.correction.corrected_targets import corrected
from analysis.correction.pose_uncertainty import few_taught, pose_uncertainty
from analysis.correction.support import supports, why_nothing
from analysis.correction.work import FEWEST_TAUGHT, taught_angles, work_or_spread
from analysis.procedures.simulate import touch_of, with_ball
from analysis.robot.kinematics.arm import Array, Integers, arm_of, forward
from analysis.runs.tables import TouchTable
from rigs.errors import FileError, RigPlace
from rigs.rig import Rig

Act = Literal["measure", "correct", "repair", "nothing"]
_LINEARISED, _STEP_MM = 30, 1e-3
"""Number of draws at which a figure is linearised, and step of the slopes."""
MANY = 20
"""Largest number of further readings that are weighed."""
PRICE = 0.1 / 30
"""Price of a minute, relative to the error now: half an hour must remove a tenth of it. Chosen."""
CORRECT_MIN, _REPAIR_MIN = 30.0, 120.0
"""Minutes to load and check corrected programs, and to repair a joint. Chosen."""
_WORTHWHILE = 0.02
"""Smallest relative reduction of u by a proposed reading: a tenth needs about five. Chosen."""
_MOST_TARGETS = 60
"""Number of targets that are weighed. Chosen: their mean hardly changes with more."""


# The reading that reduces the uncertainty of a figure most.


@dataclass(frozen=True)
class NextReading:
    reading: Reading
    u_mm: float | None = None
    """Standard uncertainty of the figure before the reading; None outside the measured region."""
    after_mm: float | None = None

    def to_dict(self) -> dict[str, Any]:
        return {**self.reading.to_dict(), "u_mm": self.u_mm, "u_after_mm": self.after_mm}


@dataclass(frozen=True)
class ProgramReadings:
    """Readings that inform about the targets of a program, with their pool."""

    readings: tuple[Reading, ...]
    pool: ReadingPool

    @classmethod
    def of(cls, rig: Rig, q: Array, taught: Array) -> ProgramReadings:
        """Readings for targets at q (n, axes) rad in a frame taught at other postures (m, axes) rad."""
        readings = [] if rig.robot.rail else possible_readings(rig)
        if all(reading.kind == "pose" for reading in readings):  # a tracker can also measure at the targets
            readings = [*poses_at(q[:_MOST_TARGETS]), *readings]
        return cls(tuple(readings), pool_of_readings(rig, readings, q, taught[few_taught(len(taught))]))

    def best_for(
        self, rows: Integers, places: Array, figure: Callable[[Array], Array], errors: Array
    ) -> NextReading | None:
        """Reading that reduces the variance of a figure most, None if none is worthwhile.

        rows (m,): targets of the figure, at places (m, 3) mm. figure: value (k,) mm for displaced positions (k, m, 3)
        mm, linearised at some errors. errors (k, m, 3): draws of the target errors.
        """
        steps = _STEP_MM * np.eye(errors[0].size).reshape(-1, *errors.shape[1:])
        displaced = (places + error for error in errors[:_LINEARISED])
        slopes = np.array([(figure(at + steps) - figure(at - steps)) / (2 * _STEP_MM) for at in displaced])
        of_targets = self.pool.targets.reshape(-1, 3, self.pool.targets.shape[1])[rows]
        gains = replace(self.pool, targets=slopes @ of_targets.reshape(slopes.shape[1], -1)).gains() / len(slopes)
        best, flat = int(np.argmax(gains)), (errors - errors.mean(axis=0)).reshape(len(errors), -1)
        remaining = 1 - gains[best] / float(((flat @ slopes.T) ** 2).mean())
        u_mm, after_mm = (float(figure(places + errors).std() * np.sqrt(share)) for share in (1.0, max(remaining, 0.0)))
        is_worthwhile = after_mm < (1 - _WORTHWHILE) * u_mm
        return NextReading(self.readings[best], u_mm, after_mm) if is_worthwhile else None


# The decision at targets.


@dataclass(frozen=True)
class NextStep:
    """Decision at targets, errors in mm rms."""

    act: Act
    """`repair` if backlash and other errors that no target corrects dominate."""
    reading: Reading
    """The most informative reading."""
    now_mm: float | None
    """Error now; None if not measured."""
    corrected_mm: float
    """Error after a correction by the readings so far."""
    next_mm: float
    """The same after one further reading, and after `many`."""
    many_mm: float
    many: int
    worthwhile: int
    """Number of readings that are worth their time, which take `minutes`."""
    minutes: float
    of_family: float
    """Share of the mean square error that the readings leave unknown, where typical sizes of the family correct."""
    is_validated: bool = False
    """True if readings that were left out of the calibration confirm its uncertainty."""
    taken: int = 0
    """Number of readings that the decision is based on, if they are part of no calibration."""

    def to_dict(self) -> dict[str, Any]:
        names = (
            "act", "now_mm", "corrected_mm", "next_mm", "many_mm", "many", "worthwhile", "minutes", "of_family",
            "is_validated",
        )  # fmt: skip
        return self.reading.to_dict() | {name: getattr(self, name) for name in names}

    @property
    def words(self) -> str:
        if self.act != "measure":
            change_mm = self.corrected_mm - self.many_mm
            decided = f"These {self.taken} {self.reading.noun} decide" if self.taken > 1 else "The readings decide"
            return f"{decided}: {_ACTS[self.act]}. {self.many} more would change {change_mm:.3f} mm."
        words = self.reading.words
        later = f"the error is then {self.next_mm:.3f} mm, and {self.many_mm:.3f} mm after {self.many}"
        worth = f"{self.worthwhile} readings are worth their" if self.worthwhile > 1 else "it is worth its"
        return f"{words[0].upper()}{words[1:]}: {later}; {worth} {self.minutes:.0f} minutes."


_ACTS = {
    "correct": "correct the targets",
    "repair": "repair the arm, most of the error is backlash or another error that no target corrects",
    "nothing": "do nothing, a correction would not reduce the error",
}


@dataclass(frozen=True)
class _Known:
    """Errors in mm rms at targets: now, those that no target corrects, and the unexplained part."""

    now: float
    stays: float
    unexplained: float
    is_validated: bool


def next_step(rig: Rig, targets: tuple[Array, Array] | None, sight: Sight | None = None) -> NextStep:
    """Decide between measuring, correcting, repairing and doing nothing, with the next reading.

    targets: postures (n, axes) rad and poses (n, 4, 4), by default the work area. Raises FileError for an arm on a
    rail.
    """
    if rig.robot.rail:
        problem = "has a rail, but readings are proposed for a fixed base"
        raise FileError(RigPlace.of(rig.name), problem, "measure poses by a plan of your own", code="arm.invalid")
    supported, is_usable = supports(rig), rig.calibrated is not None and not why_nothing(rig)
    joints = pose_uncertainty(rig, supported).joints_rad if is_usable else None
    q = work_or_spread(rig, joints) if targets is None else targets[0]
    few = few_taught(len(q))[:_MOST_TARGETS]
    q, wanted = q[few], None if targets is None else targets[1][few]
    error = corrected(rig, supported, q, (), wanted).error if is_usable else None
    known = None
    if error is not None:
        unexplained = pose_uncertainty(rig, supported).unexplained_mm
        stays = float(np.sqrt(max(error.after_um**2 - error.u_um**2, 0.0))) / 1e3
        is_validated = rig.calibrated is not None and rig.calibrated.held_out_um is not None
        known = _Known(error.before_um / 1e3, stays, unexplained, is_validated)
    measured = rig if is_usable else rig.nominal
    readings = possible_readings(rig, sight)
    taught = q if len(q) >= FEWEST_TAUGHT else taught_angles(rig, joints)
    pool = pool_of_readings(measured, readings, q, taught)
    return decide(pool, readings, known)


def next_touch(rig: Rig, touches: TouchTable, socket: str) -> NextStep | None:
    """Weigh another touch of a known socket for the work area of an arm with typical errors; None without a posture."""
    touch, nominal = touch_of(rig), rig.nominal
    balls = forward(with_ball(arm_of(rig.robot), touch), touches.q[touches.socket == socket])[:, :3, 3]
    if not (possible := touches_at(rig, {socket: balls[0]})):
        return None
    taken = [Reading("touch", TOUCH_MIN, q, name) for q, name in zip(touches.q, touches.socket.tolist(), strict=True)]
    work = work_or_spread(nominal, None)
    readings = [*taken, *possible]
    return decide(pool_of_readings(nominal, readings, work, work), readings, taken=len(taken))


def decide(pool: ReadingPool, readings: Sequence[Reading], known: _Known | None = None, *, taken: int = 0) -> NextStep:
    """Weigh the acts now and after each number of further readings.

    known: errors by a calibration. taken: number of the first readings, taken but part of no calibration. Without
    both, an arm must be measured first.
    """
    chosen = pool.choose(taken + MANY, range(taken))
    base = np.hypot(known.stays, known.unexplained) if known else 0.0
    counts = range(taken, len(chosen) + 1)
    after = np.array([np.hypot(base, pool.u_mm(chosen[:count])) for count in counts])
    minutes = np.concatenate([[0.0], np.cumsum(pool.minutes[chosen[taken:]])])
    now = float(np.hypot(known.now, after[0])) if known else pool.u_mm(chosen[:0])
    price = PRICE * now
    losses: dict[Act, Array] = {"correct": after + price * CORRECT_MIN, "nothing": np.full_like(after, now)}
    if known:
        losses["repair"] = np.full_like(after, np.sqrt(max(now**2 - known.stays**2, 0.0)) + price * _REPAIR_MIN)
    worthwhile = int(np.argmin(np.min(list(losses.values()), axis=0) + price * minutes))
    if known is None and not taken:
        worthwhile = max(worthwhile, 1)
    act: Act = "measure" if worthwhile else min(losses, key=lambda one: losses[one][0])
    of_family = min(1.0, (pool.u_mm(chosen[:0]) / max(known.now, 1e-9)) ** 2) if known else 1.0
    return NextStep(
        act, readings[chosen[taken]], known.now if known else None, float(after[0]), float(after[1]), float(after[-1]),
        len(after) - 1, worthwhile, float(minutes[worthwhile]), of_family,
        known is not None and known.is_validated, taken,
    )  # fmt: skip
