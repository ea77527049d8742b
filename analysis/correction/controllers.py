"""The controllers: the parameters in which each holds the zero of a joint and the constants of the arm.

A correction says that at an unchanged posture a joint must read `add_deg` more. Each controller computes its reading in
its own way, and from that the change of its parameter follows:

- KUKA: at the mastering notch an axis reads $MAMES, so $MAMES grows by the same degrees.
- FANUC, Yaskawa: an axis reads (count - count at zero) / counts per degree, so the count at zero falls.
- ABB: an axis reads (motor angle - calibration offset) / gear ratio, so the calibration offset falls.
- Universal Robots: the angle of the link is the reading plus delta_theta, so delta_theta grows; the reading stays.

Counts per degree and gear ratios belong to each axis of each model, with the sign of its motor; they are not public for
all, so a person gives them. Without them a change is stated in degrees of the reading.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from rigs.errors import UseError
from rigs.schema.vocabulary import Maker


@dataclass(frozen=True)
class ConstantParameter:
    """The parameter of a link constant: `key` as in the rig file, `name` and `unit` at the controller, and its change
    `per_unit` for a mm or degree. `later` is by how many axes the rig file has the constant later: Craig's a and alpha
    stand at the axis after the link."""

    key: str
    name: str
    unit: str
    per_unit: float
    later: int = 0


@dataclass(frozen=True)
class Controller:
    """How one maker's controller holds zeros and constants.

    `zero` names the parameter of the zero of axis {axis}; one degree more of the reading changes it by `per_deg` of
    `unit`, times the axis' scale where `scale` says what that is. `changes_reading` states whether the reading of a
    joint changes, or only the arm's model. `steps` are for the person at the controller; `source` is public, and
    `missing` says what was not found.
    """

    maker: str
    zero: str
    unit: str
    per_deg: float
    scale: str
    steps: tuple[str, ...]
    source: str
    missing: str
    changes_reading: bool = True
    constants: tuple[ConstantParameter, ...] = ()

    @property
    def check(self) -> str:
        """What proves that a value was entered with the right sign, before the robot moves."""
        return _CHECK_READING if self.changes_reading else _CHECK_MODEL


_CHECK_READING = (
    "Check before any motion, since no real controller has tested these signs: at an unchanged posture every corrected "
    "axis must now read the degrees above more than before, and no other axis anything else. If not, enter the old "
    "value again."
)
_CHECK_MODEL = (
    "Check before any motion, since no real controller has tested these signs: the joint angles on the pendant must be "
    "those of before; the position of the tool changes. If not, restore calibration.conf."
)

CONTROLLERS: dict[Maker, Controller] = {
    "ur": Controller(
        "Universal Robots",
        "delta_theta[{axis}]",
        "rad",
        math.radians(1),
        "",
        (
            "Values are added to those in the controller's calibration.conf; values in [ ] count from 1.",
            "Keep a copy of calibration.conf; the controller reads it when it starts.",
            "delta_a and delta_alpha fit where the rig file holds the robot's own calibration, or where delta_theta of "
            "that joint is near zero.",
        ),
        "docs.ros.org, ur_calibration: the DH parameters of a calibrated robot; "
        "github.com/savidini/match_ur_control_backup: units",
        "a and alpha before joint 1 belong to the base frame; beta has no parameter",
        changes_reading=False,
        constants=(
            ConstantParameter("a_mm", "delta_a", "m", 1e-3, later=1),
            ConstantParameter("alpha_deg", "delta_alpha", "rad", math.radians(1), later=1),
            ConstantParameter("d_mm", "delta_d", "m", 1e-3),
        ),
    ),
    "fanuc": Controller(
        "FANUC",
        "$DMR_GRP[1].$MASTER_COUN[{axis}]",
        "counts",
        -1.0,
        "counts per degree",
        (
            "Change the count, then calibrate (MENU, SYSTEM, Master/Cal).",
            "Set the quick master reference again: the old $REF_POS and $REF_COUNT belong to the old zero.",
        ),
        "a service article, no manual of the maker: industrialmonitordirect.com/blogs/knowledgebase/"
        "reset-fanuc-extended-axis-master-count-without-continuous-turn",
        "counts per degree of the axes and parameters for link constants were not found in public",
    ),
    "kuka": Controller(
        "KUKA",
        "$MAMES[{axis}]",
        "deg",
        1.0,
        "",
        (
            "Change the machine data, then master the axis at its notch again: there it reads $MAMES.",
            "Programs that were taught keep their joint angles, so their points move with the correction.",
        ),
        "KUKA KR C2 operating handbook, machine data 2.1.7: manualshive.com/en/manual/kuka/kr-c2/2009633?page=12",
        "no public parameter for link constants was found (the file of an absolutely accurate robot is not public)",
    ),
    "abb": Controller(
        "ABB",
        "MOTOR_CALIB rob1_{axis} cal_offset",
        "rad",
        -math.radians(1),
        "gear ratio",
        (
            "Change the calibration offset in the topic Motion (MOC.cfg), then restart the controller.",
            "Where the new offset leaves the turn of the motor (± 2π rad), update the revolution counters as well.",
        ),
        "a service article, no manual of the maker: industrialmonitordirect.com/blogs/knowledgebase/"
        "abb-irb-6400-axis-3-encoder-drift-after-fine-calibration",
        "the sign of the offset, gear ratios and parameters for link constants were not found in public",
    ),
    "yaskawa": Controller(
        "Yaskawa",
        "home position (ABSO data) of axis {axis}",
        "pulses",
        -1.0,
        "pulses per degree",
        ("Change the absolute data of the home position, in management mode.",),
        "a service article, no manual of the maker: industrialmonitordirect.com/blogs/knowledgebase/"
        "yaskawa-dx100-home-position-mastering-pulse-recovery-guide",
        "the sign of the pulses, pulses per degree and parameters for link constants were not found in public",
    ),
}
"""The controllers by maker. Their signs follow from how each computes its reading, and the factors convert degrees and
mm to its units; each states its public source."""


def scale_of(text: str | None) -> tuple[float, ...] | None:
    """Return the scale of each axis (6,) from a comma-separated list, or None for none. Raises UseError for anything
    but six numbers other than zero."""
    if text is None:
        return None
    try:
        scale = tuple(float(part) for part in text.split(","))
    except ValueError:
        scale = ()
    if len(scale) != 6 or not all(math.isfinite(one) and one for one in scale):
        raise UseError("--scale", f"{text!r} is not six numbers other than zero", "give one an axis, with commas")
    return scale
