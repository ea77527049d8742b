"""Handmade diagnoses of every condition, for tests of reports."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from analysis.diagnosis.judge.acts import Act, Against, Cost, NamingTest
from analysis.diagnosis.judge.budget_part import BudgetPart
from analysis.diagnosis.judge.named import Named, Rival
from analysis.diagnosis.judge.residuals import Curve, Map, Residual, ResidualBand, ResidualPlace
from analysis.diagnosis.judge.result import Accuracy, Condition, Diagnosis, Gap
from analysis.robot.predict import SetUp
from rigs.effects import Backlash, JointOffset, LinkGeometry
from rigs.load import load
from rigs.schema.effect import name_of

RIG = load("paper-fanuc")[0].model_copy(update={"effects": ()})
PLAY = Named(
    Backlash(axis=1, width_deg=0.05213, transit=0.31),
    {"width_deg": 0.0011, "transit": 0.042},
    0.9997,
    (),
    5.94,
    "take up the play of axis 1's reducer, 0.052°, or have it looked at",
    5.78,
    0.91,
    u_um=0.12,
    times_usual=5.2,
    alone_um=2.04,
)
ZERO = Named(
    JointOffset(axis=5, offset_deg=0.1032),
    {"offset_deg": 0.0041},
    0.62,
    (Rival(LinkGeometry(axis=5, field="a", delta=0.5871), {"delta": 0.023}, 0.36),),
    5.2,
    "re-master axis 5 by 0.103°",
    5.1,
    0.88,
    u_um=0.2,
    times_usual=3.1,
    alone_um=3.4,
)
FAR = replace(
    ZERO,
    effect=ZERO.effect.model_copy(update={"offset_deg": 9.8132}),
    probability=1.0,
    rivals=(),
    twins=(LinkGeometry(axis=5, field="a"),),
)
"""A joint zero beyond the bound of a rig file."""
SMALL = replace(ZERO, contribution_um=0.9, probability=0.999, rivals=(), doubt="usual", times_usual=0.4)
PLACES = (
    ResidualPlace("yaw", "cw", "angle", 231.4, 243.0, 1, "reversal", 14.21, 22.4),
    ResidualPlace("yaw", "acw", "distance", 352.0, 8.0, None, "orders 8–29", 3.1, 6.2),
    ResidualPlace("roll", "acw", "distance", 0.0, 360.0, None, "slow, orders 0–7", 2.1, 4.4),
    ResidualPlace("radial", None, "distance", 3, 7, None, "outermost ring", 22.0, 31.0),
)
_PHI = np.linspace(0, 359, 360)
_TURNS = ((105.2, 1), (237.0, 1), (20.0, 2), (24.0, 3), (31.0, 5), (200.0, 4), (290.0, 6), (358.0, 5))


def curve(test: Any, direction: Any, seed: int) -> Curve:
    """A residual curve: a step between two reversals before the model is extended, noise after."""
    rng = np.random.default_rng(seed)
    noise = rng.normal(0, 0.5, (len(_PHI), 2))
    step = np.where((_PHI > 105) & (_PHI < 237), 7.0, -7.0)
    return Curve(test, direction, _PHI, noise + np.stack([step, -0.6 * step], axis=1), noise, _TURNS)


def sphere() -> Map:
    """Return residuals with three readings at each of 37 targets."""
    polar = np.repeat([0.0, *[30.0] * 12, *[60.0] * 12, *[90.0] * 12], 3)
    azimuth = np.repeat([0.0, *np.tile(np.arange(0, 360, 30), 3)], 3)
    noise = np.random.default_rng(3).normal(0, 2.0, len(polar))
    before = 25 * np.sin(np.radians(polar)) * np.cos(np.radians(azimuth)) + noise
    return Map("radial", np.repeat(np.arange(1.0, 38.0), 3), polar, azimuth, before, noise)


def poses() -> Map:
    """Return residuals of 200 rows of poses, which have no place on a hemisphere."""
    left = np.abs(np.random.default_rng(5).normal(0, 400.0, 200))
    nowhere = np.full(200, np.nan)
    return Map("pose", np.arange(1.0, 201.0), nowhere, nowhere, 2 * left, left)


def budget(effects: Sequence[Named]) -> tuple[BudgetPart, ...]:
    """Return budget parts for the effects, which share nine tenths of the error equally, and for the remaining
    error.
    """
    each = 0.9 / max(len(effects), 1)
    found = [
        BudgetPart(
            "effect", one.contribution_um, one.u_um, each, axis=getattr(one.effect, "axis", None),
            name=name_of(one.effect), times_usual=one.times_usual,
            rank="unusual" if one.is_confirmed else "usual", odds=one.probability,
            held_out_gain=one.held_out_gain, doubt=one.doubt, index=k,
        )
        for k, one in enumerate(effects)
    ]  # fmt: skip
    left = 0.1 if effects else 1.0
    found += [
        BudgetPart("scatter", 1.7, 0.0, left - 0.0304),
        BudgetPart("warming", 0.01, 0.02, 0.0004, rank="undecided"),
    ]
    found.append(BudgetPart("constants", 0.8, 0.5, 0.03, times_usual=0.1, rank="usual"))
    return tuple(sorted(found, key=lambda one: -one.share))


LOAD = Act(
    "load",
    "correction",
    (0,),
    4.2,
    0.3,
    "held_out",
    2.1,
    0.3,
    Cost(0.0),
    command=("correct", "FOUND/cell.yaml", "-o", "D"),
)
REPEAT = Act("measure", "few_runs", runs=3)
APART = Act(
    "measure", "rivals", (0,), cost=Cost(4.6, 2, 1),
    test=NamingTest("circle of radius 140 mm", "an angle's effect grows with the radius", 12.3, 0.9999),
)  # fmt: skip
REPAIR = Act("repair", "fault", (0,), 4.1, 0.2, "held_out", 2.0, 0.2, effect=PLAY.effect, u=0.0011)
REMASTER = Act(
    "remaster", "fault", (0,), 2.6, 0.2, "held_out", 3.4, 0.2, effect=ZERO.effect, u=0.0041,
    against=(Against("rivals", names=("link_geometry 5.a",)),),
)  # fmt: skip
ACTS: dict[Condition, tuple[Act, ...]] = {
    "named": (REPAIR,),
    "ambiguous": (APART, REMASTER),
    "out_of_range": (Act("check", "out_of_range", (0,), 5.1, 0.2, "used", 1.0, 0.2, effect=FAR.effect, u=0.0041),),
    "outside_library": (Act("mount", "unexplained"), REPAIR),
    "undecided": (REPEAT,),
    "uncalibrated": (LOAD,),
    "nothing_unusual": (Act("none", "sound"),),
    "not_testable_here": (Act("measure", "not_visible", command=("plan", "cell.yaml")),),
}


def diagnosis(condition: Condition = "named", **changed: Any) -> Diagnosis:
    """A diagnosis with a condition and all optional parts, with fields replaced by `changed`."""
    known: dict[Condition, tuple[Named, ...]] = {
        "named": (PLAY,), "ambiguous": (ZERO,), "out_of_range": (FAR,), "outside_library": (PLAY, ZERO)
    }  # fmt: skip
    effects = changed.get("effects", known.get(condition, ()))
    after = 1.91 if effects else 6.12
    setup = SetUp(np.array([930.8, -87.8, 273.2]), np.array([0.01, -0.02]), np.eye(4), np.eye(4))
    made = Diagnosis(
        condition=condition,
        accuracy=Accuracy(None, None, 6.12, 21.4, 1.9, 6.3, "held_out"),
        budget=budget(effects) if condition != "not_testable_here" else (),
        runs_to_decide=3 if condition == "undecided" else None,
        rig=RIG,
        runs=("yaw-acw-001", "yaw-acw-002", "yaw-cw-001", "yaw-cw-002"),
        where=PLACES,
        effects=effects,
        residual=Residual(1.4, 0.05, "yaw cw, angle: 8 to 29 cycles a lap, 1.5 times the noise", 2.2),
        train=Gap(("yaw-acw-001", "yaw-cw-001"), 6.12, after, 1.88, 1.7),
        held_out=Gap(("yaw-acw-003",), 6.3, after, 1.9, 1.75),
        unseen=None,
        bands=(ResidualBand("yaw", "cw", "angle", (8, 29), 2.31, "orders 8–29 are 1.5 times the noise"),),
        setups={"yaw": setup},
        groups=(("joint_offset 5", "link_geometry 5.a"),),
        not_testable=("joint_offset 1", "joint_offset 6", "link_geometry 6.a", "time_lag"),
        next_test=NamingTest("circle of radius 140 mm", "an angle's effect grows with the radius", 12.3, 0.9999),
        repeated=True,
        levels={"others": 0.2, "constants": 0.3, "gravity": 0.5},
        doubts=("the runs are of one direction only",),
        curves=(curve("yaw", "acw", 1), curve("yaw", "cw", 2), curve("roll", "acw", 3), curve("roll", "cw", 4)),
        maps=(sphere(),),
        seconds=1.84,
        acts=ACTS[condition],
    )
    return replace(made, **changed)


def judged(found: Diagnosis, **accuracy: Any) -> Diagnosis:
    """A diagnosis with other values of its accuracy."""
    return replace(found, accuracy=replace(found.accuracy, **accuracy))
