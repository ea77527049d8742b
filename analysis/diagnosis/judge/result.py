"""Result of a diagnosis as values: the answer, the error budget and all other reported facts."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

import pyarrow as pa

from analysis.diagnosis.fit.background import Work
from analysis.diagnosis.fit.contradictions import Contradiction
from analysis.diagnosis.judge.acts import Act, JudgedOn, NamingTest
from analysis.diagnosis.judge.budget_part import BudgetPart
from analysis.diagnosis.judge.correlations import Correlation, correlations_of
from analysis.diagnosis.judge.named import Named
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
from analysis.procedures.shared.quantity import Quantity
from analysis.procedures.shared.test_kind import facts_of
from analysis.robot.predict import SetUp
from analysis.runs.tabular import Tabular, for_json, table_of_rows
from rigs.calibration import CalibratedModel
from rigs.effects import Effect
from rigs.rig import Rig
from rigs.schema.effect import name_of
from rigs.schema.limits import Standing
from rigs.schema.part import Vector
from rigs.schema.vocabulary import WITHOUT_GAUGES, TestName

Condition = Literal[
    "named", "ambiguous", "out_of_range", "outside_library", "undecided", "uncalibrated", "nothing_unusual",
    "not_testable_here",
]  # fmt: skip
"""Condition of the arm: effects are named; named, but a rival is possible; a single parameter exceeds the range that
rig corrects; the cause is not in the library; the runs are too few; many usual errors that a calibration was shown to
remove; nothing unusual; or the runs cannot show effects.
"""


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
    left_out_um: float | None = None
    """Residual of poses or touches used in the fit, each group of similar postures predicted from the others; None if
    the `place` is another, or if no reading was left out."""
    left_out_u_um: float | None = None

    def to_dict(self) -> dict[str, Any]:
        return {**asdict(self), "standing": self.standing or "not_judged"}


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

    The value of a distance is NaN (null in the JSON) if its uncertainty exceeds the error of the runs.
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
    fixed: tuple[Effect, ...] = ()
    """Effects that the user excluded from the fit; they keep the value of the rig file."""
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
    def correlations(self) -> tuple[Correlation, ...]:
        """Correlations of the effects given to be fitted, the strongest first; empty for a search."""
        if self.calibrated is None or not self.given:
            return ()
        return correlations_of(self.calibrated, [name.effect for name in self.effects])

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
        outside, correlations = {"held_out": self.held_out, "unseen_place": self.unseen}, self.correlations
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
                **({"fixed": [name_of(effect) for effect in self.fixed]} if self.fixed else {}),
                **({"correlations": [pair.to_dict() for pair in correlations]} if correlations else {}),
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
