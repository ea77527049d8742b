"""Calibrations and rig files of both arms of a pair."""

from __future__ import annotations

import datetime as dt
import hashlib
from pathlib import Path

import numpy as np

from analysis.apps.pair.arm_terms import PairArm
from analysis.apps.pair.fit_pair import FittedPair
from analysis.apps.pair.result import PairResult
from analysis.robot.geometry.pose_setup import frame
from analysis.robot.kinematics.arm import Array, roll_pitch_yaw
from rigs.calibration import (
    TIMES,
    CalibratedModel,
    CalibratedRun,
    CovarianceParameter,
    ModelAssessment,
    PlacedSetUp,
    covariance_root,
    packed_factor,
)
from rigs.calibration import Term as CalibratedTerm
from rigs.distribution import version
from rigs.edit import Keys, Value, with_values
from rigs.rig import Rig
from rigs.schema.declared_tests import Touch
from rigs.schema.robot import Pose

_SETUP = "pair"
_DIGITS = 6
"""Decimals of mm and degrees in a rig file."""


def calibrations(fit: FittedPair, result: PairResult, table: Path) -> tuple[CalibratedModel, CalibratedModel]:
    """Each arm with its terms at their marginal posterior."""
    run = CalibratedRun(name=table.name, sha256=hashlib.sha256(table.read_bytes()).hexdigest())
    before_um = 1000 * result.before_mm
    judged = [
        ModelAssessment(
            condition="uncalibrated", place="held_out", before_um=before_um, names_um=before_um,
            whole_um=1000 * result.left_mm, handed_um=1000 * result.left_mm, noise_um=1000 * result.scatter_mm,
            unexplained_um=1000 * unexplained,
        )
        for unexplained in result.unexplained_mm
    ]  # fmt: skip
    count, mounted = len(fit.pair.first.terms), fit.pair.table.is_mounted
    socket = fit.state.sockets_mm[fit.pair.table.socket[mounted][0]]
    end = count + len(fit.pair.second.terms)
    return (
        _calibration(fit, fit.pair.first, slice(0, count), fit.pair.table.q, fit.state.ball_mm, run, judged[0]),
        _calibration(fit, fit.pair.second, slice(count, end), fit.pair.table.p[mounted], socket, run, judged[1]),
    )


def _calibration(
    fit: FittedPair,
    arm: PairArm,
    columns: slice,
    q: Array,
    point_mm: Array,
    run: CalibratedRun,
    judged: ModelAssessment,
) -> CalibratedModel:
    terms = tuple(
        CalibratedTerm(effect=term.effect, times=float(times))
        for term, times in zip(arm.terms, fit.posterior.mean[columns], strict=True)
    )
    frames = [tuple(tuple(row) for row in T.tolist()) for T in (np.eye(4), frame(np.eye(3), point_mm))]
    angles = np.degrees(q)
    return CalibratedModel(
        rig=arm.rig.name, date=dt.datetime.now(dt.UTC).date(), version=version(), runs=(run,),
        joints_deg=tuple(zip(angles.min(axis=0).tolist(), angles.max(axis=0).tolist(), strict=True)),
        setups={_SETUP: PlacedSetUp(T_instrument_world=frames[0], T_tool_target=frames[1])},
        before_um=judged.before_um, calibrated_um=judged.whole_um, held_out_um=judged.handed_um, judged=judged,
        terms=terms, parameters=tuple(CovarianceParameter(term=k, field=TIMES) for k in range(len(terms))),
        factor=packed_factor(covariance_root(fit.posterior.cov[columns, columns])),
    )  # fmt: skip


def placed_texts(fit: FittedPair, texts: tuple[str, str]) -> tuple[str, str]:
    """Both rig files with the fitted ball and socket, and with the base of the second arm in the world of the first."""
    socket = fit.state.sockets_mm[fit.pair.table.socket[fit.pair.table.is_mounted][0]]
    T = fit.state.T_first_second @ fit.pair.second.model.arm.T_world_base
    base = Pose(xyz_mm=_rounded(T[:3, 3]), rpy_deg=_rounded(np.degrees(roll_pitch_yaw(T))))
    first, second = fit.pair.first.rig, fit.pair.second.rig
    return _placed(texts[0], first, fit.state.ball_mm, None), _placed(texts[1], second, socket, base)


def _placed(text: str, rig: Rig, point_mm: Array, base: Pose | None) -> str:
    changes: dict[Keys, Value] = {}
    expected = rig
    if rig.tests.touch is not None:
        touch: Touch = rig.tests.touch.model_copy(update={"ball_mm": _rounded(point_mm)})
        changes["tests", "touch", "ball_mm"] = touch.ball_mm
        expected = expected.model_copy(update={"tests": rig.tests.model_copy(update={"touch": touch})})
    if base is not None:
        changes |= {
            ("robot", "base", key): value for key, value in (("xyz_mm", base.xyz_mm), ("rpy_deg", base.rpy_deg))
        }
        expected = expected.model_copy(update={"robot": rig.robot.model_copy(update={"base": base})})
    return with_values(text, changes, expected, rig.name)


def _rounded(values: Array) -> tuple[float, float, float]:
    x, y, z = (round(float(value), _DIGITS) for value in values)
    return x, y, z
