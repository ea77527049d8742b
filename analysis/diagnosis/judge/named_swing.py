"""Vibration of the link as a named effect, and doubts about vibrations fitted with a common phase."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analysis.diagnosis.evidence.link_swing import FoundVibration
from analysis.diagnosis.fit.responses import RmsByBlock
from analysis.diagnosis.judge.result import CERTAIN_SIGMA, ODDS, Named
from analysis.robot.kinematics.arm import Array
from rigs.schema.effect import size_field


def named_vibration(swing: FoundVibration, limits: Array, gap_um: float) -> list[Named]:
    """Return a vibration of the link as a named effect, if the rms change exceeds a limit (b,) µm and the odds of any
    vibration are at least 20 to 1.

    The phase is new in each run; therefore no model removes the vibration from the readings. A wave that may follow
    the angle of the circle is as likely a path error of the controller, such as chords, and no confirmed fault.
    """
    if swing.gain < np.log(ODDS):
        return []
    moves = RmsByBlock(np.full(len(limits), 1e3 * swing.amplitude_mm / np.sqrt(2)))
    if not moves.is_material(limits):
        return []
    odds = 1 / (1 + float(np.exp(-min(swing.gain, 50.0))))
    named = Named(swing.effect, swing.sd, odds, (), gap_um, swing.effect.remedy(), moves.whole_um, None)
    return [replace(named, probability=odds / 2, doubt="unexplained") if swing.may_follow_angle else named]


def doubts_of_phases(vibrations: Sequence[Named], left: FoundVibration) -> tuple[str, ...]:
    """Return a doubt about each vibration fitted with a common phase and frequency in all runs. The condition is a
    remaining vibration `left` larger than the uncertainty of the fit.
    """
    size = size_field(left.effect)
    return tuple(
        f"after the fitted vibration is removed, the runs still contain a {left.effect.plain('')} of "
        f"{left.amplitude_mm:.4f} ± {left.sd[size]:.4f} mm: a fit with one phase and one frequency for all runs "
        "cannot represent the scatter between runs"
        for name in vibrations
        if left.gain >= np.log(ODDS) and left.amplitude_mm > CERTAIN_SIGMA * name.sd[size]
    )
