"""The controllers: the parameters in which each holds the zero of a joint and the constants of the arm.

A correction says that at an unchanged posture a joint must read `add_deg` more. Each controller computes its reading in
its own way, and from that the change of its parameter follows:

- KUKA: at the mastering notch an axis reads $MAMES, so $MAMES grows by the same degrees.
- FANUC, Yaskawa: an axis reads (count - count at zero) / counts per degree, so the count at zero falls.
- ABB: an axis reads (motor angle - calibration offset) / gear ratio, so the calibration offset falls.
- Universal Robots: the angle of the link is the reading plus delta_theta, so delta_theta grows; the reading stays.

The constants of the arm are lengths and angles of links. Where the direction in which a maker counts a length is not
public, the growth of the length is stated, with the size that must stand there before it is changed.

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
    stand at the axis after the link. `axes` are those of the rig file that have it, from 1. `by_size` states that the
    direction in which the maker counts the length is not public: the length grows, whichever sign it is written with,
    and a length of zero has no parameter."""

    key: str
    name: str
    unit: str
    per_unit: float
    later: int = 0
    axes: tuple[int, ...] = (1, 2, 3, 4, 5, 6)
    by_size: bool = False

    def of(self, axis: int) -> str:
        """Return its name for an axis of the rig file."""
        return self.name.format(axis=axis - self.later)


@dataclass(frozen=True)
class Controller:
    """How one maker's controller holds zeros and constants.

    `zero` names the parameter of the zero of axis {axis}; one degree more of the reading changes it by `per_deg` of
    `unit`, times the axis' scale where `scale` says what that is. `changes_reading` states whether the reading of a
    joint changes, or only the arm's model. `steps` are for the person at the controller; `source` is public, and
    `missing` says what was not found, `place` where a person enters the values. A source marked (W) is no manual of the
    maker.
    """

    maker: str
    place: str
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

    @property
    def check_lengths(self) -> str:
        """What proves that a length is the one that is meant, where the maker's order of them is not public."""
        return _CHECK_LENGTH


_CHECK_READING = (
    "Check before any motion, since no real controller has tested these signs: at an unchanged posture every corrected "
    "axis must now read the degrees above more than before, and no other axis anything else. If not, enter the old "
    "value again."
)
_CHECK_MODEL = (
    "Check before any motion, since no real controller has tested these signs: the joint angles on the pendant must be "
    "those of before; the position of the tool changes. If not, restore calibration.conf."
)

_CHECK_LENGTH = (
    "Check each length before it is changed: the controller's value must be the one given as now, whichever its "
    "sign, and the new one is longer for + and shorter for -. If another value stands there, leave it and hold the "
    "rest by corrected targets."
)
_LATER = (2, 3, 4, 5, 6)
"""Axes of the rig file with a link before them that is the controller's."""

CONTROLLERS: dict[Maker, Controller] = {
    "ur": Controller(
        "Universal Robots",
        "calibration.conf",
        "delta_theta[{axis}]",
        "rad",
        math.radians(1),
        "",
        (
            "Values are added to those in the controller's calibration.conf; values in [ ] count from 1.",
            "Keep a copy of calibration.conf; the controller reads it when it starts.",
            "delta_a and delta_alpha fit where the rig file holds the robot's own calibration, or where delta_theta of "
            "that axis is near zero.",
        ),
        "docs.ros.org, ur_calibration: the DH parameters of a calibrated robot; "
        "github.com/savidini/match_ur_control_backup: units (W); the maker's forum, threads 538 and 18921 (W): the "
        "file can be written, and holds calibration_status = 2 for a linearised robot",
        "a and alpha before axis 1 belong to the base frame; beta has no parameter; whether a controller accepts a "
        "changed file with the old joint_checksum was not found: keep calibration_status and the checksums as they are",
        changes_reading=False,
        constants=(
            ConstantParameter("a_mm", "delta_a[{axis}]", "m", 1e-3, 1, _LATER),
            ConstantParameter("alpha_deg", "delta_alpha[{axis}]", "rad", math.radians(1), 1, _LATER),
            ConstantParameter("d_mm", "delta_d[{axis}]", "m", 1e-3),
        ),
    ),
    "fanuc": Controller(
        "FANUC",
        "the system variables",
        "$DMR_GRP[1].$MASTER_COUN[{axis}]",
        "counts",
        -1.0,
        "counts per degree",
        (
            "Change the count, then calibrate (MENU, SYSTEM, Master/Cal).",
            "Set the quick master reference again: the old $REF_POS and $REF_COUNT belong to the old zero.",
            "Note the old lengths; new ones count after a cold start.",
        ),
        "service articles (W): industrialmonitordirect.com/blogs/knowledgebase/"
        "reset-fanuc-extended-axis-master-count-without-continuous-turn, "
        "…/fanuc-robot-dh-parameters-system-variables-reference; a user's report (W) that lengths took effect on an "
        "LR Mate 200iD and angles did not: robot-forum.com/robotforum/thread/23503-modify-fanuc-dh-parameters",
        "counts per degree of the axes, the signs of lengths and a manual of the maker for them were not found in "
        "public, nor how the maker's own calibration option keeps its values: corrected targets are the way to the "
        "rest",
        constants=(
            ConstantParameter("a_mm", "$PARAM_GROUP[1].$DH_A[{axis}]", "mm", 1.0, 1, _LATER, by_size=True),
            ConstantParameter("d_mm", "$PARAM_GROUP[1].$DH_D[{axis}]", "mm", 1.0, by_size=True),
        ),
    ),
    "kuka": Controller(
        "KUKA",
        "the machine data ($machine.dat)",
        "$MAMES[{axis}]",
        "deg",
        1.0,
        "",
        (
            "Change the machine data, then master the axis at its notch again: there it reads $MAMES.",
            "Programs that were taught keep their joint angles, so their points move with the correction.",
            "Only a person trained for machine data may change them; keep a copy of the file.",
        ),
        "KUKA KR C2 operating handbook, machine data 2.1.7 and 2.1.156 to 2.1.161: "
        "manualshive.com/en/manual/kuka/kr-c2/2009633, pages 12, 76 and 77",
        "which components of $TX3P3 and $TFLWP hold a length, the signs of $DH_4 and $DH_5, and whether a newer "
        "controller keeps changed machine data were not found in public; the model of an absolutely accurate robot "
        "(PID file) is closed, and where $ABS_ACCUR says that it is active these values do not say where the arm is: "
        "use corrected targets",
        constants=(
            ConstantParameter("a_mm", "$LENGTH_A", "mm", 1.0, axes=(2,), by_size=True),
            ConstantParameter("a_mm", "$LENGTH_B", "mm", 1.0, axes=(3,), by_size=True),
            ConstantParameter("a_mm", "height in $TX3P3", "mm", 1.0, axes=(4,), by_size=True),
            ConstantParameter("d_mm", "length in $TX3P3", "mm", 1.0, axes=(4,), by_size=True),
            ConstantParameter("d_mm", "length in $TFLWP", "mm", 1.0, axes=(6,), by_size=True),
        ),
    ),
    "abb": Controller(
        "ABB",
        "the topic Motion (MOC.cfg)",
        "MOTOR_CALIB rob1_{axis} cal_offset",
        "rad",
        -math.radians(1),
        "gear ratio",
        (
            "Change the calibration offset in the topic Motion (MOC.cfg), then restart the controller.",
            "Where the new offset leaves the turn of the motor (± 2π rad), update the revolution counters as well.",
        ),
        "a service article (W): industrialmonitordirect.com/blogs/knowledgebase/"
        "abb-irb-6400-axis-3-encoder-drift-after-fine-calibration",
        "the sign of the offset and gear ratios were not found in public; a robot with the option Absolute Accuracy "
        "has values of its links in MOC.cfg, whose frames are not public (W: "
        "github.com/ros-industrial/abb/discussions/195), so corrected targets are the way to the rest",
    ),
    "yaskawa": Controller(
        "Yaskawa",
        "the home position (ABSO data)",
        "home position (ABSO data) of axis {axis}",
        "pulses",
        -1.0,
        "pulses per degree",
        ("Change the absolute data of the home position, in management mode.",),
        "a service article (W): industrialmonitordirect.com/blogs/knowledgebase/"
        "yaskawa-dx100-home-position-mastering-pulse-recovery-guide",
        "the sign of the pulses and parameters for link constants were not found in public, so corrected targets are "
        "the way to the rest; pulses per degree follow from the gear ratio and encoder in ALL.PRM (W): "
        "industrialmonitordirect.com/blogs/knowledgebase/calculating-pulses-per-degree-on-yaskawa-up130-robot-axes",
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
