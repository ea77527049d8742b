"""Result of a diagnosis as values: the answer, the error budget and all other reported facts."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

import pyarrow as pa

from analysis.diagnosis.evidence.significance import SURE_SIGMA
from analysis.diagnosis.fit.background import Work
from analysis.diagnosis.fit.contradictions import Contradiction
from analysis.diagnosis.judge.acts import Act, Doubt, JudgedOn, NamingTest
from analysis.diagnosis.judge.alternatives import Alternative
from analysis.diagnosis.judge.probability import CONFIRMED
from analysis.diagnosis.judge.residuals import (
    Curve,
    HeldOutResidual,
    Map,
    Residual,
    ResidualBand,
    ResidualPlace,
    Staircase,
    independent_um,
)
from analysis.procedures.shared.quantity import Quantity, parameters_of
from analysis.procedures.shared.test_kind import facts_of
from analysis.robot.predict import SetUp
from analysis.runs.tabular import Tabular, for_json, table_of_rows
from rigs.calibration import CalibratedModel
from rigs.effects import Effect
from rigs.rig import Rig
from rigs.schema.effect import SEATS, PartKind, name_of, size_field
from rigs.schema.limits import Standing
from rigs.schema.part import Vector
from rigs.schema.vocabulary import WITHOUT_GAUGES, TestName

# ----------------------------------------------------------------------------------------------------------------------
# Answer of a diagnosis as values: condition of the arm, accuracy, and error budget.

Condition = Literal[
    "named", "ambiguous", "out_of_range", "outside_library", "undecided", "uncalibrated", "nothing_unusual",
    "not_testable_here",
]  # fmt: skip
"""Condition of the arm: effects are named; named, but a rival is possible; a single parameter exceeds the range that
rig corrects; the cause is not in the library; the runs are too few; many usual errors that a calibration was shown to
remove; nothing unusual; or the runs cannot show effects.
"""
Rank = Literal["unusual", "usual", "undecided", "difference"]
"""Whether an effect is larger than in healthy arms and than others in this arm. A `difference` is a link constant that
differs from the data sheet: no fault, at any size.
"""


@dataclass(frozen=True)
class GroupMember:
    """A candidate effect for a group of small terms: fitted size, rms in µm within the group, and odds of being the
    dominant effect.
    """

    effect: Effect
    um: float
    odds: float
    u_um: float = 0.0

    @property
    def sd(self) -> dict[str, float]:
        """Standard uncertainty of the size, in proportion to that of the rms; empty if unknown."""
        field = size_field(self.effect)
        return {field: abs(getattr(self.effect, field)) * self.u_um / self.um} if self.um > 0 else {}

    def to_dict(self) -> dict[str, Any]:
        return _of_effect(self.effect, self.sd, self.odds) | {"um": self.um, "u_um": self.u_um}


@dataclass(frozen=True)
class BudgetPart:
    """A part of the gap: a fitted `effect`, `scatter` between runs, `unexplained`, or a group of small terms."""

    kind: PartKind | Literal["effect", "scatter", "unexplained"]
    um: float
    """Root mean square in the readings with set-ups fitted."""
    u_um: float
    share: float
    """Share of the energy of the gap. Shares add up to 1 and are never negative; two parts divide a common
    contribution equally, and a part that cancels another is counted with it.
    """
    axis: int | None = None
    """Joint of an effect or a group, if it has one."""
    name: str = ""
    times_usual: float | None = None
    """Ratio to a healthy arm; None if undefined."""
    rank: Rank | None = None
    odds: float | None = None
    held_out_gain: float | None = None
    doubt: Doubt | None = None
    index: int | None = None
    """Index of the fitted effect among the effects of the diagnosis."""
    members: tuple[GroupMember, ...] = ()
    """Candidate effects of a group with more than a third of the gap, likeliest first."""
    together: tuple[BudgetPart, ...] = ()
    """Parts that partly cancel each other and are counted together, each with the individual size, this part first."""

    @property
    def cancelled(self) -> tuple[str, ...]:
        return tuple(part.label for part in self.together[1:])

    @property
    def shown_together(self) -> tuple[BudgetPart, ...]:
        """This part and the parts that cancel over 5 % of it and over twice their uncertainty; empty without any."""
        large = [part for part in self.together[1:] if part.um > max(2 * part.u_um, self.together[0].um / 20)]
        return (self.together[0], *large) if large else ()

    @property
    def label(self) -> str:
        return self.name or (f"{self.kind} {self.axis}" if self.axis else self.kind)

    @property
    def cause(self) -> GroupMember | None:
        """The certain member of a group: the only dominant effect, with known contribution."""
        likeliest = next(iter(self.members), None)
        is_cause = likeliest and likeliest.odds >= CONFIRMED and likeliest.um > SURE_SIGMA * likeliest.u_um
        return likeliest if is_cause else None

    @property
    def sigma(self) -> float:
        return self.um / self.u_um if self.u_um > 0 else float("inf")

    def to_dict(self) -> dict[str, Any]:
        parts = {name: [part.to_dict() for part in getattr(self, name)] for name in ("together", "members")}
        return {**vars(self), **parts, "class": self.rank, "cancelled": self.cancelled}


@dataclass(frozen=True)
class Accuracy:
    """Error of the arm now and after calibration, in µm of the readings."""

    standing: Standing | None
    """Comparison of the present error with the `limit`; None without one."""
    limit: Literal["tolerance", "rig_file", "data_sheet"] | None
    now_um: float
    """Of the runs used, as `now_largest_um`."""
    now_largest_um: float
    calibrated_um: float
    """Residual of the calibrated model at the `place`: on places or runs not used in the fit, if available."""
    before_there_um: float
    place: JudgedOn

    def to_dict(self) -> dict[str, Any]:
        return {**asdict(self), "standing": self.standing or "not_judged"}


# ----------------------------------------------------------------------------------------------------------------------
# Result of a diagnosis, in reading order.
#
# residual of the initial model → missing effects → residual of the extended model → effects that these tests cannot
# distinguish → actions → next test

_DIFFERS = 0.5
"""Difference of the shares of two set-ups above which they contradict a named effect, if certain. Chosen: several times
those of true faults.
"""
LEAST_SHARE = 0.1
"""Share of the error above which every part has an action, or a reason for its absence."""
LARGE_SHARE = 1 / 3
"""Share of the error from which the first sentence mentions a part, and a group lists its possible causes."""


@dataclass(frozen=True)
class Share:
    """Size of a named effect in a single set-up as a share of the fitted size."""

    setup: str
    value: float
    sd: float


@dataclass(frozen=True)
class Rival:
    """Alternative to a named effect, with its `probability`."""

    effect: Effect
    sd: dict[str, float]
    probability: float
    is_fault: bool = False
    """Whether the rival would be a fault: larger than in arms of the same build."""

    def to_dict(self) -> dict[str, Any]:
        return _of_effect(self.effect, self.sd, self.probability)


PRESENT: tuple[Doubt | None, ...] = (None, "usual")
"""Doubts with which an effect is nevertheless present."""


@dataclass(frozen=True)
class Named:
    """An effect missing in the model, as found by a diagnosis."""

    effect: Effect
    sd: dict[str, float]
    """Standard uncertainty of each parameter, in the unit of the parameter."""
    probability: float
    """Calibrated probability that the effect exists (docs/probability.md)."""
    rivals: tuple[Rival, ...]
    gap_without_um: float
    """RMS residual on the runs used if only this effect is removed from the model."""
    remedy: str
    contribution_um: float
    """RMS change of the readings caused by the effect, without the part that a set-up absorbs."""
    held_out_gain: float | None
    """Share of the squared residual that the effect removes on held-out runs; None if none shows it."""
    doubt: Doubt | None = None
    """Reason why the effect is not confirmed as a fault."""
    shares: tuple[Share, ...] = ()
    u_um: float = 0.0
    """Standard uncertainty of `contribution_um`."""
    times_usual: float | None = None
    """Size relative to a healthy arm; None if a healthy size is invisible."""
    alone_um: float = math.nan
    """RMS residual on the runs used if only this effect is added to the model."""
    twins: tuple[Effect, ...] = ()
    """Effects indistinguishable from this one, so only their sum is known."""
    shown: bool = True
    """False if the readings cannot identify the cause, such as a wave with fewer than two driven periods."""
    alternatives: Mapping[Alternative, float] = field(default_factory=dict)
    """Probability of each alternative; together with `probability` they sum to 1."""
    log_odds: float | None = None
    """Log odds against all alternatives before their calibration; None for a vibration."""

    @property
    def is_confirmed(self) -> bool:
        """True if the effect is confirmed as a fault."""
        return self.doubt is None

    @property
    def unknown(self) -> float:
        """Probability of a cause that rig does not know, behind this effect alone or behind several."""
        return self.alternatives.get("unknown", 0.0) + self.alternatives.get("several", 0.0)

    @property
    def contradicted(self) -> bool:
        """True if set-ups show clearly different sizes, so that the effect imitates another cause."""
        if not self.shares:
            return False
        least, most = (of(self.shares, key=lambda share: share.value) for of in (min, max))
        return most.value - least.value > max(_DIFFERS, SURE_SIGMA * math.hypot(least.sd, most.sd))

    def to_dict(self) -> dict[str, Any]:
        """Plain types, including the rivals."""
        return {
            **_of_effect(self.effect, self.sd, self.probability),
            "rivals": [rival.to_dict() for rival in self.rivals],
            "worth_um": self.contribution_um,
            "u_um": self.u_um,
            "times_usual": self.times_usual,
            "stands": self.is_confirmed,
            "doubt": self.doubt,
            "log_odds": self.log_odds,
            "alternatives": dict(self.alternatives),
            "alone_um": self.alone_um,
            "twins": [name_of(twin) for twin in self.twins],
            "held_out_gain": self.held_out_gain,
            "contradicted": self.contradicted,
            "shares": {share.setup: {"value": share.value, "sd": share.sd} for share in self.shares},
            "gap_without_um": self.gap_without_um,
            "remedy": self.remedy,
        }


def _of_effect(effect: Effect, sd: Mapping[str, float], posterior: float) -> dict[str, Any]:
    return {
        "effect": effect.effect,
        **{key: getattr(effect, key) for key in SEATS if hasattr(effect, key)},
        "name": name_of(effect),
        "parameters": {field: {"value": value, "sd": sd.get(field)} for field, value in parameters_of(effect).items()},
        "posterior": posterior,
    }


@dataclass(frozen=True)
class TestGap:
    """Residual of a single test: root mean square and maximum, before and with the calibrated model."""

    test: TestName
    before_um: float
    before_largest_um: float
    calibrated_um: float
    calibrated_largest_um: float

    def to_dict(self) -> dict[str, float]:
        return {key: value for key, value in asdict(self).items() if key != "test"}


_SHAPES = 2.0
"""Independent shapes of the residual at a place: half of the residual is then the standard uncertainty at the next
place, 1 / √(2 · 2). Chosen: the fewest for which it is defined.
"""


@dataclass(frozen=True)
class Gap:
    """Root mean square of the residual, before and after the effects are added to the model."""

    runs: tuple[str, ...]
    before_um: float
    after_um: float
    noise_floor_um: float
    """Noise and scatter between runs, partly absorbed by a fitted set-up."""
    calibrated_um: float
    """With everything that the runs used determine."""
    tests: tuple[TestGap, ...] = ()
    keeps_setup: bool = True
    """These runs have the set-up of a run used; otherwise one is fitted to them."""
    rows: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    """Table rows, from 1, by run, if rig excluded a part of the runs from the fit."""

    @property
    def of_places(self) -> bool:
        """Whether the arm rested at each reading: poses and touches only, whose places predict each other."""
        return bool(self.tests) and all(facts_of(tested.test).of_places for tested in self.tests)

    @property
    def u_um(self) -> float:
        """Standard uncertainty of the initial residual: noise of a run divided by the root of their number."""
        return self.noise_floor_um / math.sqrt(max(len(self.runs), 1))

    @property
    def residual_u_um(self) -> float:
        """Standard uncertainty of the residual of a model: `u_um`, and half of the calibrated residual beyond the
        noise, which may differ in the next run.
        """
        missed_um = independent_um(self.calibrated_um, self.noise_floor_um)
        return math.hypot(self.u_um, missed_um / math.sqrt(2 * _SHAPES))

    def to_dict(self) -> dict[str, Any]:
        """Plain types; the keys omit the unit, µm."""
        return {
            "before": self.before_um,
            "before_u": self.u_um,
            "after": self.after_um,
            "calibrated": self.calibrated_um,
            "calibrated_u": self.residual_u_um,
            "noise_floor": self.noise_floor_um,
            "set_up": "kept" if self.keeps_setup else "fitted",
            "tests": {tested.test: tested.to_dict() for tested in self.tests},
            "runs": self.runs,
            **({"rows": dict(self.rows)} if self.rows else {}),
        }


Alike = Literal["instrument", "plate", "base", "tool"]


@dataclass(frozen=True)
class Movement:
    """A movement before the first reading of `to`."""

    from_: str
    to: str
    """A run, or a run and row."""
    what: Literal["base", "instrument", "socket", "target", "tool", "zero"]
    odds: float
    axis: int | None = None
    name: str = ""
    translation_mm: Vector | None = None
    """In the axes of the base, for a tool those of the flange, as `rotation_deg`."""
    rotation_deg: Vector | None = None
    size_deg: float | None = None
    """Of a zero of `axis`."""
    u_mm: float | None = None
    """Standard uncertainty of the length of the shift, `u_deg` of a zero."""
    u_deg: float | None = None
    u_rotation_deg: float | None = None
    run: str = ""
    row: int | None = None
    """Row of the file of `run` from which it moved; None between runs."""
    alike: Alike | None = None
    """Part with the same readings, if any."""

    def to_dict(self) -> dict[str, Any]:
        return {
            "from": self.from_, "to": self.to, "what": self.what, "alike": self.alike, "axis": self.axis,
            "name": self.name or None,
            "translation_mm": self.translation_mm, "rotation_deg": self.rotation_deg, "size_deg": self.size_deg,
            "u_mm": self.u_mm, "u_deg": self.u_deg, "odds": self.odds,
        }  # fmt: skip


@dataclass(frozen=True)
class Passport:
    """RMS distances of the tool in µm over the joint ranges of the runs, with base and tool taught; None if unknown.

    changed: certain effects that are not part of the factory state or of the last visit.
    """

    data_sheet: Quantity | None
    controller: Quantity | None
    last_visit: Quantity | None
    changed: tuple[Effect, ...]

    @property
    def distances(self) -> dict[str, Quantity]:
        every = {"data_sheet": self.data_sheet, "controller": self.controller, "last_visit": self.last_visit}
        return {name: distance for name, distance in every.items() if distance is not None}

    def to_dict(self) -> dict[str, Any]:
        none = dict.fromkeys(("data_sheet_um", "controller_um", "last_visit_um"))
        known = {f"{name}_um": {"value": of.value, "u": of.u} for name, of in self.distances.items()}
        return none | known | {"changed": [name_of(effect) for effect in self.changed]}


@dataclass(frozen=True, kw_only=True, repr=False)
class Diagnosis(Tabular):
    """The complete result of a diagnosis."""

    condition: Condition
    accuracy: Accuracy
    budget: tuple[BudgetPart, ...]
    """All parts of the residual, largest first."""
    runs_to_decide: int | None
    """Number of runs of each kind that would decide an undecided condition."""
    rig: Rig
    """The initial model."""
    runs: tuple[str, ...]
    where: tuple[ResidualPlace, ...]
    """Places with large residuals."""
    effects: tuple[Named, ...]
    """Effects supported by evidence, faults first, then by size of their contribution."""
    residual: Residual
    """Part of the readings that nothing explains."""
    train: Gap
    held_out: Gap | None
    unseen: Gap | None
    """Gap of the runs at a different place."""
    bands: tuple[ResidualBand, ...]
    """Residual of the calibrated model by frequency band."""
    setups: dict[str, SetUp]
    groups: tuple[tuple[str, ...], ...]
    """Effects that these tests cannot distinguish from each other."""
    not_testable: tuple[str, ...]
    """Effects that are invisible in these runs at any size."""
    repeated: bool
    """True if the noise is estimated from repeated runs."""
    levels: dict[str, float]
    """Size of small errors, 1 in a healthy arm: of `constants`, of deflection (`gravity`) and of all `others`."""
    curves: tuple[Curve, ...]
    maps: tuple[Map, ...]
    """Residuals at the targets; `curves` are those over the circle angle."""
    given: bool = False
    """True if the effects were given by the user, as in `calibrate`."""
    shows_noise: bool = False
    """True if the noise is estimated from repeats or residuals; otherwise it is assumed."""
    next_test: NamingTest | None = None
    """Shortest test that would distinguish the remaining possibilities."""
    doubts: tuple[str, ...] = ()
    seconds: float = 0.0
    work: Work = field(default_factory=Work)
    calibrated: CalibratedModel | None = None
    staircase: Staircase | None = None
    """Residual as the parts of the budget are added to the model one after the other."""
    only_commanded: bool = False
    """True if some run contains commanded instead of measured joint angles; an effect may then be an angle that was
    not reached."""
    acts: tuple[Act, ...] = ()
    """Recommended actions in order; every report prints this list."""
    movements: tuple[Movement, ...] = ()
    """Movements between the runs or between rows of a run."""
    contradictions: tuple[Contradiction, ...] = ()
    """Stated constants that the readings contradict. The diagnosis does not use them."""
    driven_corrected: bool = False
    """True if the robot drove corrected programs. Its joint angles still show the error of the arm itself."""
    passport: Passport | None = None
    """Distances of the real arm from its data sheet, its controller and the last visit; None without a model."""

    def __repr__(self) -> str:
        causes = ", ".join(name_of(name.effect) for name in self.standing) or "no cause confirmed"
        return f"<diagnosis of {self.rig.name}, {len(self.runs)} runs: {self.condition}, {causes}>"

    @property
    def remainder(self) -> Residual:
        """Deprecated name of `residual`."""
        return self.residual

    @property
    def unexplained(self) -> Residual:
        """Deprecated name of `residual`."""
        return self.residual

    @property
    def remains(self) -> HeldOutResidual | None:
        """Deprecated name of `residual.held_out`."""
        return self.residual.held_out

    @property
    def left(self) -> tuple[ResidualBand, ...]:
        """Deprecated name of `bands`."""
        return self.bands

    @property
    def is_testable(self) -> bool:
        """True if the runs can show effects. If not, the residual of a calibration from them is unknown."""
        return self.condition != "not_testable_here"

    @property
    def is_modelled(self) -> bool:
        """True if a calibrated model is written and reported."""
        return self.is_testable and self.condition != "out_of_range"

    @property
    def written(self) -> tuple[Named, ...]:
        """Effects written to a rig file: the faults, or all effects if they were given to be fitted."""
        if self.condition == "out_of_range":
            return ()
        return self.effects if self.given else self.standing

    @property
    def standing(self) -> tuple[Named, ...]:
        """Effects confirmed as faults."""
        return tuple(name for name in self.effects if name.is_confirmed)

    @property
    def contradicted(self) -> tuple[Named, ...]:
        """Effects that imitate a different cause, and are therefore not written."""
        return tuple(name for name in self.effects if name.contradicted)

    @property
    def extended_rig(self) -> Rig:
        """The initial rig with the written effects and the calibrated model, for `calibrated_arm`."""
        effects = (*self.rig.effects, *(name.effect for name in self.written))
        calibrated = self.calibrated if self.is_modelled else None
        return self.rig.model_copy(update={"effects": effects}).with_calibration(None, calibrated)

    def parts(self, is_meant: Callable[[BudgetPart], bool]) -> tuple[int, ...]:
        """Indices of some parts of the budget."""
        return tuple(k for k, part in enumerate(self.budget) if is_meant(part))

    def named_of(self, part: BudgetPart) -> Named | None:
        """The fitted effect that is a part of the budget; None for scatter, the unexplained and groups."""
        return None if part.index is None else self.effects[part.index]

    @property
    def next_act(self) -> Act | None:
        """The first recommended action; None if the effects were given and need none."""
        return self.acts[0] if self.acts else None

    def to_table(self) -> pa.Table:
        """A row for each parameter of each effect: name, parameter, value, sd, posterior, worth_um, stands."""
        rows = [
            effect | of_field | {"parameter": field}
            for effect in self.to_dict()["effects"]
            for field, of_field in effect["parameters"].items()
        ]
        return table_of_rows(("name", "parameter", "value", "sd", "posterior", "worth_um", "stands"), rows)

    def to_dict(self) -> dict[str, Any]:
        """Plain types with the keys of docs/diagnosis.md, as printed by `rig diagnose --json`.

        Angles are in degrees, residuals in µm, each parameter in the unit of its name. None means unknown.
        """
        outside = {"held_out": self.held_out, "unseen_place": self.unseen}
        gaps = {"train": self.train.to_dict()} | {name: gap and gap.to_dict() for name, gap in outside.items()}
        accuracy = self.accuracy.to_dict()
        if not self.is_modelled:
            for figures, key in ((accuracy, "calibrated_um"), *((gap, "calibrated") for gap in gaps.values() if gap)):
                figures.update({name: None for name in (key, f"{key}_u") if name in figures})
        plain: dict[str, Any] = for_json(
            {
                "condition": self.condition,
                "accuracy": accuracy,
                "budget": [part.to_dict() for part in self.budget],
                "acts": [act.to_dict() for act in self.acts],
                "movements": [movement.to_dict() for movement in self.movements],
                **({"contradictions": [made.to_dict() for made in self.contradictions]} if self.contradictions else {}),
                "runs_to_decide": self.runs_to_decide,
                "passport": self.passport.to_dict() if self.passport else None,
                "rig": self.rig.name,
                "runs": self.runs,
                "effects": [name.to_dict() for name in self.effects],
                **self.residual.to_dict(),
                "where": [place.to_dict() for place in self.where],
                "gap": {"unit": "um", "noise_floor": self.train.noise_floor_um, **gaps},
                "left": [asdict(band) for band in self.bands],
                "setup": {
                    name: {"T_instrument_world": setup.T_instrument_world, "T_tool_target": setup.T_tool_target}
                    if name.startswith(WITHOUT_GAUGES)
                    else {"ball_mm": setup.ball, "zeros_mm": setup.zeros_mm}
                    for name, setup in self.setups.items()
                },
                "groups": self.groups,
                "not_testable": self.not_testable,
                "next_test": asdict(self.next_test) if self.next_test else None,
                "staircase": self.staircase.to_dict([part.label for part in self.budget]) if self.staircase else None,
                "repeats_measured": self.repeated,
                "only_commanded": self.only_commanded,
                "driven_corrected": self.driven_corrected,
                "level": self.levels["others"],
                "levels": self.levels,
                "doubts": self.doubts,
                "seconds": self.seconds,
            }
        )
        return plain
