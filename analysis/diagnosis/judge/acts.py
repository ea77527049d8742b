"""Actions from a diagnosis as values: task, reduction, remaining error, and objections.

Every output uses this list; the texts come from `analysis.apps.report.act_words`. The first action is the next step.
Actions are sorted by their reduction at a place not used in the model.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal, Protocol, TypeVar

from rigs.effects import Effect
from rigs.schema.effect import label_of

ActKind = Literal[
    "repair", "remaster", "enter", "load", "approach", "measure", "mount", "wait", "convert", "check", "none"
]
"""Action of the operator: repair a cause; re-master a joint; enter a constant; load corrected programs or entries;
approach targets from the same side; measure to decide; mount ball, gauges or base again; wait until the arm is
warm; convert readings of another convention; check the rig file and the variant of the arm; or nothing."""
JudgedOn = Literal["unseen", "held_out", "used"]
"""Basis of a figure: a different place, held-out runs, or the runs used."""
Doubt = Literal[
    "usual", "one_lap", "healthy_shows_it", "rival", "unsure", "contradicted", "unexplained", "commanded"
]  # fmt: skip
"""Reason for not confirming an effect: no larger than elsewhere in this arm or in healthy arms; slow, and a single lap
in each direction shows no time dependence; the size may be usual, or noise explains it; set-ups show different shares;
or its likeliest alternative: a healthy arm, a rival, a cause that rig does not know, or an angle that the arm did not
reach.
"""
IMITATED: tuple[Doubt, ...] = ("unexplained", "commanded")
"""Doubts about an effect of the size of a fault that a different cause may imitate."""
Objection = Literal["rivals", "doubt", "not_judged_elsewhere", "few_runs", "unexplained", "no_place", "corrected"]
"""Objection to an action: a different cause is possible (`names`); the effect is doubted (`doubt`); no run of a
different place validated it; too few runs (`runs` of each kind would decide); a large unexplained error; the
rig file has no further test; or the robot drives with a correction that the action would have to replace.
"""
Reason = Literal[
    "fault", "sure_and_large", "not_enough", "correction", "rivals", "group", "few_runs", "one_lap", "unexplained",
    "not_visible", "elsewhere", "scatter", "too_small", "history", "gauges", "sound", "early", "out_of_range",
    "follows", "revisit", "visits_differ", "gauges_differ", "moved", "commanded", "contradicted", "other_robot",
    "corrected",
]  # fmt: skip
"""Reason for an action in the list: a fault; a usual error that is large and cannot be removed otherwise; such an
error, if the interim correction is insufficient; the interim correction; rivals to separate; a group to identify; too
few runs; a single lap in each direction, which shows no slow change; an unknown cause; an effect not visible in the
tests; unknown accuracy elsewhere; joints read too early; a parameter out of range; a test of the dependence of the
unexplained part; single visits, which do not separate scatter from error; visits of a target that differ by more than
the usual repeatability; two gauges whose difference changes between repeats more than the tool moves; a movement
between or within the runs; angles that are only commanded; a stated constant that
the readings contradict; constants of the controller that may be those of another robot.

Reason for no action: the error differs from run to run; the gain of a correction is too small; a target cannot contain
an error that depends on the approach; the error belongs to the gauges; the arm is sound; the robot drives corrected.
"""


@dataclass(frozen=True)
class Against:
    """Objection to an action."""

    why: Objection
    names: tuple[str, ...] = ()
    doubt: Doubt | None = None
    runs: int | None = None


@dataclass(frozen=True)
class Cost:
    minutes: float | None = None
    """Minutes of driving; None if unknown (a repair)."""
    programs: int = 0
    """Programs to drive or load."""
    set_ups: int = 0
    """Set-ups of ball and gauges."""


FOUND = "FOUND/"
"""Placeholder directory of the model in commands until the user's directory is known."""


@dataclass(frozen=True)
class NamingTest:
    """A decisive test."""

    test: str
    """Arguments of `rig plan`."""
    why: str
    expected_sigma: float
    odds_then: float
    """Expected odds of the likeliest cause after the test."""
    names: tuple[str, ...] = ()
    """Causes that it separates."""


@dataclass(frozen=True)
class Act:
    """An action. Errors are the rms of the readings in µm, each with standard uncertainty; None if not computed."""

    kind: ActKind
    why: Reason
    parts: tuple[int, ...] = ()
    """Indices into the budget."""
    removes_um: float | None = None
    """Reduction by this action alone at the `place`; None for actions that do not reduce the error themselves."""
    removes_u_um: float | None = None
    place: JudgedOn = "used"
    remains_um: float | None = None
    """Remaining error at the `place`; without a reduction, the error of the part to which the action refers."""
    remains_u_um: float | None = None
    cost: Cost = Cost()
    with_before_um: float | None = None
    """Remaining error at the `place` after all preceding manual actions of the list; None for the first."""
    with_before_u_um: float | None = None
    effect: Effect | None = None
    """Effect to repair or enter."""
    u: float | None = None
    """Standard uncertainty of the size of the effect."""
    command: tuple[str, ...] = ()
    """Words after `rig` if a command does the work, files in capitals."""
    test: NamingTest | None = None
    """Test to drive."""
    runs: int | None = None
    """Number of runs of each test, if more runs decide."""
    against: tuple[Against, ...] = ()
    conditional: bool = False
    """True if the cause that the action removes is not certain. The action applies only if this cause is confirmed."""

    @property
    def removes(self) -> bool:
        """True if the action certainly reduces the error: by more than two standard uncertainties."""
        return self.gain_um > 2 * (self.removes_u_um or 0.0) and self.gain_um > 0

    @property
    def gain_um(self) -> float:
        """Reduction in µm for sums and order, 0 if not computed."""
        return self.removes_um or 0.0

    @property
    def residual_um(self) -> float:
        """Remaining error in µm for sums and order, 0 if not computed."""
        return self.remains_um or 0.0

    def to_dict(self) -> dict[str, Any]:
        """Plain types, with the effect as a label."""
        plain = {key: value for key, value in asdict(self).items() if key != "effect"}
        return plain | {"effect": label_of(self.effect) if self.effect else None}


def acts_with(acts: Sequence[Act], model: str, again: tuple[str, ...] = ()) -> tuple[Act, ...]:
    """Put the user's `model` into the commands. Without a model, the command of a correction becomes `again`, the
    arguments of the command that writes the model, and other commands that need it become empty.
    """

    def command(act: Act) -> tuple[str, ...]:
        if model or not any(word.startswith(FOUND) for word in act.command):
            return tuple(model if word.startswith(FOUND) else word for word in act.command)
        return again if act.kind == "load" else ()

    return tuple(replace(act, command=command(act)) for act in acts)


@dataclass(frozen=True)
class ActiveCorrection:
    """Correction with which a robot drives, and its measured error in µm; None if not measured."""

    way: Literal["entries", "programs"]
    um: float | None = None
    u_um: float = 0.0


CORRECTED = Act("none", "corrected")
"""First action if the robot drives with a correction that no other action improves."""


class ListedAct(Protocol):
    """An action of a diagnosis or of a session."""

    @property
    def kind(self) -> str: ...
    @property
    def why(self) -> str: ...
    @property
    def remains_um(self) -> float | None: ...
    @property
    def with_before_um(self) -> float | None: ...


_Listed = TypeVar("_Listed", bound=ListedAct)


def open_acts(
    acts: Sequence[_Listed], active: ActiveCorrection | None, *, elsewhere: bool
) -> tuple[tuple[_Listed, ...], tuple[_Listed, ...]]:
    """Divide actions that are not done into those to do, and those that would only replace the active correction.

    An action that changes the arm makes the active correction wrong. It is worthwhile only if one or several of them
    leave a smaller error than the corrected robot has. elsewhere: a different place has validated the model.
    """
    offered = [act for act in acts if not (active and is_contained(act, active))]
    changes = [act for act in offered if act.kind in CHANGES_ARM]
    left_um = [act.remains_um for act in changes]
    if len(changes) == sum(act.kind in CHANGES_ARM for act in acts):  # several together, if all of them are offered
        left_um += [act.with_before_um for act in changes]
    least_um = min((um for um in left_um if um is not None), default=math.inf)
    is_better = active is None or active.um is None or least_um + 2 * active.u_um < active.um
    to_do, instead = list[_Listed](), list[_Listed]()
    for act in offered:
        if not (elsewhere and (act.kind, act.why) == ("measure", "elsewhere")):
            is_instead = act.kind in CHANGES_ARM and act.remains_um is not None and not is_better
            (instead if is_instead else to_do).append(act)
    return tuple(to_do), tuple(instead)


def is_contained(act: ListedAct, active: ActiveCorrection) -> bool:
    """True if the active correction contains an action. Entered values include zeros: re-mastering corrects twice."""
    return act.kind in ("load", "enter", "approach") or (act.kind == "remaster" and active.way == "entries")


CHANGES_ARM = ("repair", "remaster", "enter", "check", "mount")
"""Kinds of actions that change the arm, its mounting or the controller, and make a correction from earlier runs wrong.
"""
