"""The result of a diagnosis, as values: the answer and its budget, and everything else that a person reads."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal

import pyarrow as pa

from analysis.diagnosis.evidence.movements import Movement
from analysis.diagnosis.judge.acts import Act, Doubt, JudgedOn
from analysis.diagnosis.judge.residuals import Curve, Map, Place, ResidualBand
from analysis.diagnosis.judge.staircase import Staircase
from analysis.procedures.shared.quantity import parameters_of
from analysis.robot.model.predict import SetUp
from analysis.runs.tabular import Tabular, for_json, table_of_rows
from rigs.calibration import CalibratedModel
from rigs.effects import Effect
from rigs.rig import Rig
from rigs.schema.effect import SEATS, PartKind, name_of, size_field
from rigs.schema.limits import Standing
from rigs.schema.vocabulary import WITHOUT_GAUGES, TestName

# ----------------------------------------------------------------------------------------------------------------------
# The answer of a diagnosis as values: the condition of the arm, its accuracy, and the budget of its error.
#
# Words are made of them at the edge, for a screen, a page or another language; nothing decides by comparing words.

Condition = Literal[
    "named", "ambiguous", "out_of_range", "outside_library", "undecided", "uncalibrated", "nothing_unusual",
    "not_testable_here",
]  # fmt: skip
"""Whether something is worn, loose or shifted: effects are named; they are, but a rival may be meant; one parameter is
further off than rig corrects, which is the only name; what explains the readings is in no library; the runs are too few
to decide it; many usual errors that a calibration was shown to remove; nothing unusual; or the runs cannot show it."""
Rank = Literal["unusual", "usual", "undecided"]
"""Whether an effect is larger than healthy arms, and this arm elsewhere, show."""


@dataclass(frozen=True)
class Member:
    """An effect that a group of small terms may be, with its size in its own unit as the readings show it beside
    everything else, the rms in µm that the group gives it with its standard uncertainty, and the odds that it is the
    one that stands out."""

    effect: Effect
    um: float
    odds: float
    u_um: float = 0.0

    @property
    def sd(self) -> dict[str, float]:
        """The standard uncertainty of its size, as that of what it does; empty where that is not known."""
        field = size_field(self.effect)
        return {field: abs(getattr(self.effect, field)) * self.u_um / self.um} if self.um > 0 else {}

    def to_dict(self) -> dict[str, Any]:
        """In plain types."""
        return _of_effect(self.effect, self.sd, self.odds) | {"um": self.um, "u_um": self.u_um}


@dataclass(frozen=True)
class BudgetPart:
    """A part of the gap. `kind` is `effect` for a fitted effect, `scatter` for what differs from run to run,
    `unexplained`, or the kind of what many small terms make together; `axis` is their joint where they have one.

    `um` is its root mean square in the readings in µm, with set-ups fitted, and `u_um` the standard uncertainty of that
    change. `share` is its share of the gap's energy: shares add up to 1, and of what two parts have in common each has
    half; none is negative, and a part that cancels another is counted with it (`cancelled`). `times_usual` is how many
    times as much it does as a healthy arm shows, None where that has no meaning. `odds`, `held_out_gain` and `doubt`
    are those of a fitted effect, and `name` its name.
    """

    kind: PartKind | Literal["effect", "scatter", "unexplained"]
    um: float
    u_um: float
    share: float
    axis: int | None = None
    name: str = ""
    times_usual: float | None = None
    rank: Rank | None = None
    odds: float | None = None
    held_out_gain: float | None = None
    doubt: Doubt | None = None
    index: int | None = None
    """The index of the fitted effect among the effects of the diagnosis."""
    members: tuple[Member, ...] = ()
    """What a group that makes more than a third of the gap may be, the likeliest first."""
    together: tuple[BudgetPart, ...] = ()
    """Where something cancels some of it and is counted with it: each of them as it is alone, the part itself first."""

    @property
    def cancelled(self) -> tuple[str, ...]:
        """The labels of what cancels some of it."""
        return tuple(part.label for part in self.together[1:])

    @property
    def shown_together(self) -> tuple[BudgetPart, ...]:
        """The part itself and what cancels more of it than 2 u and a twentieth; empty where nothing does."""
        large = [part for part in self.together[1:] if part.um > max(2 * part.u_um, self.together[0].um / 20)]
        return (self.together[0], *large) if large else ()

    @property
    def label(self) -> str:
        """What it is, for a machine: the name of an effect, or its kind with the axis."""
        return self.name or (f"{self.kind} {self.axis}" if self.axis else self.kind)

    @property
    def cause(self) -> Member | None:
        """The member of a group that is certain: it alone stands out, and what it does is known."""
        likeliest = next(iter(self.members), None)
        is_cause = likeliest and likeliest.odds >= CERTAIN_ODDS and likeliest.um > SURE_SIGMA * likeliest.u_um
        return likeliest if is_cause else None

    @property
    def sigma(self) -> float:
        """How many standard uncertainties it is away from nothing."""
        return self.um / self.u_um if self.u_um > 0 else float("inf")

    def to_dict(self) -> dict[str, Any]:
        """In plain types."""
        parts = {name: [part.to_dict() for part in getattr(self, name)] for name in ("together", "members")}
        return {**vars(self), **parts, "class": self.rank, "cancelled": self.cancelled}


@dataclass(frozen=True)
class Accuracy:
    """The error of the arm now and after calibration, in µm of the readings.

    `standing` judges the error now against the limits of the rig file, a tolerance or the data sheet (`limit`), and is
    None where there is none. `now_um` and `now_largest_um` are of the runs used. `calibrated_um` is what the calibrated
    model left at the `place`: at places or runs that had no part in it, where there are any.
    """

    standing: Standing | None
    limit: Literal["tolerance", "rig_file", "data_sheet"] | None
    now_um: float
    now_largest_um: float
    calibrated_um: float
    before_there_um: float
    place: JudgedOn

    def to_dict(self) -> dict[str, Any]:
        """In plain types."""
        return {**asdict(self), "standing": self.standing or "not_judged"}


# ----------------------------------------------------------------------------------------------------------------------
# The result of a diagnosis, in the order in which a person reads it.
#
# where model and measurement disagree → which effect is missing → what the model says with it → what remains → what
# these tests cannot distinguish → what to do → which test to run next

_DIFFERS, _DIFFERS_SIGMA = 0.5, 3.0
"""Difference of the shares of two set-ups above which they contradict a name, and the standard uncertainties by which
they must differ. Chosen: several times what true faults showed in cases for development, and odds of 400 to 1."""
ODDS = 20.0
"""Odds at which a rival is dismissed, 20 to 1: the usual 5 % level. A name with a closer rival is ambiguous."""


SURE_SIGMA = 3.0
"""Standard uncertainties from which an effect that has no rival is sure. Chosen: odds of 400 to 1."""
CERTAIN_ODDS = ODDS / (1 + ODDS)
"""Share of the evidence from which a name has no rival."""
LARGE_SHARE = 1 / 3
"""Share of the error from which a part is said in the first sentence, whatever its size, and a group names what it may
be."""
CERTAIN_SIGMA = 7.0
"""Standard uncertainties from which what an effect does is certain, whatever its size: the detection limit of the plan.
"""


@dataclass(frozen=True)
class Share:
    """The size of a name in one set-up alone as a share of its fitted size, and its standard uncertainty."""

    setup: str
    value: float
    sd: float


@dataclass(frozen=True)
class Rival:
    """Another effect that could replace a name, with the standard uncertainties of its parameters and its share of the
    evidence."""

    effect: Effect
    sd: dict[str, float]
    posterior: float
    is_fault: bool = False
    """Whether it would be a fault: larger than arms of its build show."""

    def to_dict(self) -> dict[str, Any]:
        """In plain types: kind and seats of the effect, its parameters with their standard uncertainties."""
        return _of_effect(self.effect, self.sd, self.posterior)


@dataclass(frozen=True)
class Named:
    """An effect that the model lacks, with its fitted parameters, their standard uncertainties, its share of the
    evidence among its rivals, the gap on the runs used if it alone is removed, and the remedy.

    `worth_um` is the rms change of the readings that it causes beyond what a set-up could absorb, `u_um` its standard
    uncertainty, and `alone_um` the gap on the runs used if it alone is added to the model. `times_usual` is how many
    times as much it does as a healthy arm shows. `doubt` says why the diagnosis does not stand by it, None where it
    does. `held_out_gain` is the share of the gap's energy on held-out runs that it removes, None where no held-out run
    shows it beyond the scatter of one run. `shares` states how much of it each set-up shows, and `twins` lists effects
    that nothing distinguishes from it: only what they make up together is known.
    """

    effect: Effect
    sd: dict[str, float]
    posterior: float
    rivals: tuple[Rival, ...]
    gap_without_um: float
    remedy: str
    worth_um: float
    held_out_gain: float | None
    doubt: Doubt | None = None
    shares: tuple[Share, ...] = ()
    u_um: float = 0.0
    times_usual: float = 0.0
    alone_um: float = math.nan
    twins: tuple[Effect, ...] = ()
    shown: bool = True
    """Whether its cause was shown: a wave of which the joint drove fewer than two names no gear."""
    directions: int = 1
    """Number of independent directions that show it: set-ups that each show its size, and runs that had no part."""

    @property
    def stands(self) -> bool:
        """Whether the diagnosis stands by it: it is a fault."""
        return self.doubt is None

    @property
    def is_term(self) -> bool:
        """Whether it is one of so many waves of a joint that they are the series of an error of another form."""
        return self.doubt == "series"

    @property
    def contradicted(self) -> bool:
        """Whether it imitates something else: two set-ups show clearly different shares of it, or it is one of a series
        of waves."""
        if self.is_term or not self.shares:
            return self.is_term
        least, most = (of(self.shares, key=lambda share: share.value) for of in (min, max))
        return most.value - least.value > max(_DIFFERS, _DIFFERS_SIGMA * math.hypot(least.sd, most.sd))

    def to_dict(self) -> dict[str, Any]:
        """In plain types, rivals with it."""
        return {
            **_of_effect(self.effect, self.sd, self.posterior),
            "rivals": [rival.to_dict() for rival in self.rivals],
            "worth_um": self.worth_um,
            "u_um": self.u_um,
            "times_usual": self.times_usual,
            "stands": self.stands,
            "doubt": self.doubt,
            "alone_um": self.alone_um,
            "twins": [name_of(twin) for twin in self.twins],
            "held_out_gain": self.held_out_gain,
            "contradicted": self.contradicted,
            "shares": {share.setup: {"value": share.value, "sd": share.sd} for share in self.shares},
            "gap_without_um": self.gap_without_um,
            "remedy": self.remedy,
        }


def _of_effect(effect: Effect, sd: Mapping[str, float], posterior: float) -> dict[str, Any]:
    """An effect in plain types, its parameters beside their standard uncertainties sd, each in its own unit."""
    return {
        "effect": effect.effect,
        **{key: getattr(effect, key) for key in SEATS if hasattr(effect, key)},
        "name": name_of(effect),
        "parameters": {field: {"value": value, "sd": sd.get(field)} for field, value in parameters_of(effect).items()},
        "posterior": posterior,
    }


@dataclass(frozen=True)
class Remainder:
    """What remains beyond the noise after the names and a healthy arm's share of every effect, with what contradicted
    names explain: its rms in µm, at most the gap, its share of the gap's energy, in which every test has the same
    weight, and where and how it shows, in words. `healthy_um` is the rms of the healthy share."""

    um: float
    share: float
    words: str
    healthy_um: float


@dataclass(frozen=True)
class TestGap:
    """What one test shows of the gap, in µm: root mean square and largest residual, before and with the calibrated
    model."""

    test: TestName
    before_um: float
    before_largest_um: float
    calibrated_um: float
    calibrated_largest_um: float

    def to_dict(self) -> dict[str, float]:
        """In plain types, without the test, in µm."""
        return {key: value for key, value in asdict(self).items() if key != "test"}


_SHAPES = 2.0
"""Independent shapes that what a model misses at one place has: half of it is then one standard uncertainty of what it
misses at the next, 1 / √(2 · 2). Chosen: the least for which an rms has a standard uncertainty at all."""


@dataclass(frozen=True)
class Gap:
    """Root mean square in µm of the residual, before and after the effects are added to the model.

    Runs with the placement of a run used keep its set-up (`keeps_setup`); others have their own, fitted to them.
    `noise_floor_um` is the rms of the noise and of the scatter between runs, of which a fitted set-up may absorb a
    part. `calibrated_um` is the rms with the calibrated model, which contains everything that the runs used determine.
    """

    runs: tuple[str, ...]
    before_um: float
    after_um: float
    noise_floor_um: float
    calibrated_um: float
    tests: tuple[TestGap, ...] = ()
    keeps_setup: bool = True

    @property
    def u_um(self) -> float:
        """Standard uncertainty of each of these figures in µm: that of the mean of so many runs, of which each has the
        noise."""
        return self.noise_floor_um / math.sqrt(max(len(self.runs), 1))

    @property
    def left_u_um(self) -> float:
        """Standard uncertainty in µm of what a model leaves: that of the gap, and what the calibrated model misses
        beyond the noise, of which half may be another next time."""
        missed_um = math.sqrt(max(self.calibrated_um**2 - self.noise_floor_um**2, 0.0))
        return math.hypot(self.u_um, missed_um / math.sqrt(2 * _SHAPES))

    def to_dict(self) -> dict[str, Any]:
        """In plain types, the keys without their unit, which is µm."""
        return {
            "before": self.before_um,
            "after": self.after_um,
            "calibrated": self.calibrated_um,
            "noise_floor": self.noise_floor_um,
            "set_up": "kept" if self.keeps_setup else "fitted",
            "tests": {tested.test: tested.to_dict() for tested in self.tests},
            "runs": self.runs,
        }


Subject = Literal["posture", "approach", "time", "temperature", "speed"]


@dataclass(frozen=True)
class Looked:
    """Something that what stays was held against: `share` is the part of its mean square that it explains at places
    left out, None where it was not looked for since these runs do not have it."""

    subject: Subject
    share: float | None


@dataclass(frozen=True)
class Remains:
    """What the model of all others leaves of each neighbourhood of places, rms in µm of a distance; the noise of a
    reading; and what it was held against."""

    um: float
    noise_um: float
    looked: tuple[Looked, ...]


What = Literal["angle", "load", "approach", "speed", "time", "place"]
"""Something that the unexplained part may follow: the angle of a joint, its torque of gravity, the side from which it
came, its speed; the time; the place of the target."""
FOLLOWED = 0.2
"""Share from which the unexplained part is said to follow something. Chosen: the best of twenty subjects explains up to
a tenth of plain noise of 40 poses."""


@dataclass(frozen=True)
class Followed:
    """Something that the unexplained part follows: what, of which joint (None for time and place), and the share of its
    variance that this explains where it was left out."""

    what: What
    axis: int | None
    share: float


@dataclass(frozen=True)
class Unexplained:
    """What no name and no usual error explains, rms in µm, and what it `follows`, the likeliest first. `scatter_um` is
    the scatter of a coordinate of poses, if that alone explains it and no target was visited twice; else None."""

    rms_um: float
    follows: tuple[Followed, ...] = ()
    scatter_um: float | None = None

    @property
    def likeliest(self) -> Followed | None:
        """What it follows for certain."""
        return next((followed for followed in self.follows if followed.share >= FOLLOWED), None)

    def to_dict(self) -> dict[str, Any]:
        """In plain types."""
        return asdict(self)


@dataclass(frozen=True)
class NextTest:
    """The shortest test that distinguishes the rivals, and the sigma to expect."""

    test: str
    why: str
    expected_sigma: float


@dataclass(frozen=True)
class Diagnosis(Tabular):
    """The complete result.

    `rig` is the initial model and `runs` names the runs used. `effects` lists the effects that are supported by
    evidence, the faults first, ordered by worth. `budget` has every part of the gap, the largest first, and
    `runs_to_decide` how many runs of each kind would decide an undecided condition. `calibrated` is the calibrated
    model, and `given` states whether the effects were given to be fitted. `groups` lists named effects that these tests
    cannot distinguish, and `not_testable` the names that no size makes visible here. `repeated` states whether the
    noise comes from repeats, `shows_noise` whether from those or from residuals, else it is assumed. `level` is that of
    the healthy background, 1 in a typical healthy arm. `doubts` lists what limits the trust in the result. `staircase`
    is the gap as parts of the budget are added to the model, None where nothing is.
    """

    condition: Condition
    accuracy: Accuracy
    budget: tuple[BudgetPart, ...]
    runs_to_decide: int | None
    rig: Rig
    runs: tuple[str, ...]
    where: tuple[Place, ...]
    effects: tuple[Named, ...]
    remainder: Remainder
    train: Gap
    held_out: Gap | None
    unseen: Gap | None
    left: tuple[ResidualBand, ...]
    setups: dict[str, SetUp]
    groups: tuple[tuple[str, ...], ...]
    not_testable: tuple[str, ...]
    next_test: NextTest | None
    repeated: bool
    level: float
    doubts: tuple[str, ...]
    curves: tuple[Curve, ...]
    maps: tuple[Map, ...]
    seconds: float
    calibrated: CalibratedModel | None = None
    given: bool = False
    shows_noise: bool = False
    staircase: Staircase | None = None
    remains: Remains | None = None
    """What stays of places after the calibrated model, and what it was held against; None without places."""
    only_commanded: bool = False
    """Whether measured joint angles are missing in some run, so that a name may be an angle that was not reached."""
    unexplained: Unexplained | None = None
    """What no name explains, and what it follows if it is much."""
    acts: tuple[Act, ...] = ()
    """What follows from it, the first act first; every output prints from here."""
    movements: tuple[Movement, ...] = ()
    """What moved between the runs or between rows of one."""

    @property
    def is_testable(self) -> bool:
        """Whether the runs can show effects; where they cannot, what a calibration by them leaves is unknown."""
        return self.condition != "not_testable_here"

    @property
    def is_modelled(self) -> bool:
        """Whether a calibrated model follows from it, as a file and in its figures: not from runs that cannot show
        effects, nor if a parameter is out of range."""
        return self.is_testable and self.condition != "out_of_range"

    @property
    def next_act(self) -> Act | None:
        """What to do next; None where fits of given effects ask for nothing."""
        return self.acts[0] if self.acts else None

    @property
    def written(self) -> tuple[Named, ...]:
        """The effects that go into a rig file: the faults, and all effects where they were given to be fitted; none
        that is out of range."""
        if self.condition == "out_of_range":
            return ()
        return self.effects if self.given else self.standing

    @property
    def standing(self) -> tuple[Named, ...]:
        """The effects that the diagnosis stands by: the faults."""
        return tuple(name for name in self.effects if name.stands)

    @property
    def contradicted(self) -> tuple[Named, ...]:
        """Those that imitate something else."""
        return tuple(name for name in self.effects if name.contradicted)

    @property
    def extended_rig(self) -> Rig:
        """The rig begun with, the effects added that the diagnosis stands by; of rivals the likeliest."""
        return self.rig.model_copy(update={"effects": (*self.rig.effects, *(name.effect for name in self.written))})

    def to_table(self) -> pa.Table:
        """The effects found, a row for each parameter: name, parameter, value, sd, posterior, worth_um, stands."""
        rows = [
            effect | of_field | {"parameter": field}
            for effect in self.to_dict()["effects"]
            for field, of_field in effect["parameters"].items()
        ]
        return table_of_rows(("name", "parameter", "value", "sd", "posterior", "worth_um", "stands"), rows)

    def to_dict(self) -> dict[str, Any]:
        """All of it in plain types, with the keys of docs/diagnosis.md: what `rig diagnose --json` prints.

        Angles in degrees, gaps in µm, each parameter in the unit of its name, None for what is not known.
        """
        outside = {"held_out": self.held_out, "unseen_place": self.unseen}
        gaps = {"train": self.train.to_dict()} | {name: gap and gap.to_dict() for name, gap in outside.items()}
        accuracy = self.accuracy.to_dict()
        if not self.is_modelled:
            for figures, key in ((accuracy, "calibrated_um"), *((gap, "calibrated") for gap in gaps.values() if gap)):
                figures[key] = None
        plain: dict[str, Any] = for_json(
            {
                "condition": self.condition,
                "accuracy": accuracy,
                "budget": [part.to_dict() for part in self.budget],
                "acts": [act.to_dict() for act in self.acts],
                "movements": [movement.to_dict() for movement in self.movements],
                "runs_to_decide": self.runs_to_decide,
                "rig": self.rig.name,
                "runs": self.runs,
                "effects": [name.to_dict() for name in self.effects],
                "remainder": asdict(self.remainder),
                "where": [place.to_dict() for place in self.where],
                "gap": {"unit": "um", "noise_floor": self.train.noise_floor_um, **gaps},
                "left": [asdict(band) for band in self.left],
                **({"remains": asdict(self.remains)} if self.remains else {}),
                **({"unexplained": self.unexplained.to_dict()} if self.unexplained else {}),
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
                "level": self.level,
                "doubts": self.doubts,
                "seconds": self.seconds,
            }
        )
        return plain


def likely_rivals(named: Named) -> list[Rival]:
    """Return the rivals of a name that cannot be dismissed."""
    return [rival for rival in named.rivals if rival.posterior * ODDS >= named.posterior]


def fault_rivals(named: Named) -> list[Rival]:
    """Return the rivals of an effect of usual size that cannot be dismissed and would be faults."""
    return [rival for rival in likely_rivals(named) if rival.is_fault and named.doubt == "usual"]


def is_open(part: BudgetPart, named: Named) -> bool:
    """Return whether an effect that is no fault, or that usual errors may show as well, makes much of the error, and
    its odds are below those of a sure name."""
    return part.share > LARGE_SHARE and named.doubt in ("usual", "healthy_shows_it") and named.posterior < CERTAIN_ODDS


def is_there(diagnosis: Diagnosis, part: BudgetPart) -> bool:
    """Return whether something does what a part says for certain, though it may be one of a few effects that look
    alike."""
    if part.index is None:
        return part.sigma >= CERTAIN_SIGMA
    # Where usual errors may show the same, it is open what does it and certain that it is done.
    return diagnosis.effects[part.index].doubt in (None, "usual", "healthy_shows_it") and part.sigma >= SURE_SIGMA


def is_sure(diagnosis: Diagnosis, part: BudgetPart) -> bool:
    """Return whether a part is there for certain, an effect without rivals or many small terms together."""
    is_certain = part.index is None or diagnosis.effects[part.index].posterior >= CERTAIN_ODDS
    return is_certain and is_there(diagnosis, part)
