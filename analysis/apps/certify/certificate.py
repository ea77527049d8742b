"""Conformity of the features of a program, by JCGM 106:2012.

A feature is accepted if it is inside its tolerance with a probability of 95 %, and rejected if it is outside with this
probability. Probabilities are shares of draws of the target errors.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache, partial
from itertools import product
from typing import Any, Literal

import numpy as np

from analysis.apps.certify.drift import Drift, Until, until
from analysis.apps.certify.features import Feature
from analysis.apps.certify.program import Listed
from analysis.apps.certify.target_errors import Cause, Work, causes_of, knowledge_of, taught_at
from analysis.apps.planning.next_reading import NextReading, ProgramReadings
from analysis.apps.planning.possible_readings import poses_at
from analysis.correction.pose_uncertainty import covered, pose_uncertainty, why_unknown
from analysis.correction.support import reason_to_measure_first, supports, why_nothing
from analysis.robot.kinematics.arm import Array, Integers
from rigs.rig import Rig

RISK = 0.05
"""Risk of each wrong decision."""
_DRAWS, _DRAWS_OF_CAUSE = 8000, 1000
"""Draws for a probability, with a standard error of 0.0025 at 95 %, and for comparing causes."""
Verdict = Literal["accept", "reject", "undecided"]


@dataclass(frozen=True)
class Judged:
    """Verdict about a feature and the figures behind it."""

    expected_mm: float | None
    u_mm: float | None
    """None outside the range of the calibration, as `probability`."""
    probability: float | None
    """Probability that the feature is inside its tolerance."""
    verdict: Verdict


@dataclass(frozen=True)
class Certified:
    """Conformity of a feature now and after `rig correct`."""

    feature: Feature
    now: Judged
    corrected: Judged
    cause: str | None
    """Largest contribution to the risk."""
    next: NextReading | None
    """Reading that would reduce the uncertainty most, if undecided."""
    why: str
    """Reason if there is no decision."""
    until: Until | None = None
    """Day on which growing errors exceed the tolerance."""
    range_mm: tuple[float, float] | None = None
    """Expected errors over the possible postures, if the postures decide differently."""

    def to_dict(self) -> dict[str, Any]:
        feature = self.feature
        return {
            "name": feature.name, "kind": feature.kind, "tolerance_mm": feature.tolerance_mm, **asdict(self.now),
            "corrected": asdict(self.corrected), "cause": self.cause,
            "next": self.next.to_dict() if self.next else None, "why": self.why,
            "until": self.until.to_dict() if self.until else None, "range_mm": self.range_mm,
        }  # fmt: skip


def certify(
    rig: Rig,
    listed: Listed,
    features: Sequence[Feature],
    *,
    rp_mm: float | None = None,
    taught: tuple[Array, Array] | None = None,
    drifts: Sequence[Drift] = (),
) -> list[Certified]:
    """Judge the features of a program now and after a correction.

    taught: postures and poses at which frame and tool are taught, by default the measured targets. drifts: growing
    figures of the robot's history.
    """
    unknown = listed.unknown
    at, choices = _with_postures(listed)
    inside = np.ones(len(at.q), dtype=bool)
    outside = dict[int, str]()
    if knowledge_of(rig) == "typical":
        unmeasured = why_nothing(rig) or "the arm was not measured, and its errors are those of a typical arm"
    else:
        unmeasured, uncertainty = reason_to_measure_first(rig), pose_uncertainty(rig, supports(rig))
        of_runs = covered(uncertainty, at.q)
        inside = inside if of_runs is None else of_runs
        outside = {k: why for k, why in enumerate(why_unknown(rig, uncertainty, at.q)) if why}
    certain = np.isin(np.arange(len(at.q)), [each[0] for each in choices.values() if len(each) == 1])
    taught = taught or taught_at(rig, at, inside & certain)
    causes = causes_of(rig, at, taught, rp_mm) if len(at.q) else []
    readings = cache(partial(ProgramReadings.of, rig, at.q[certain], taught[0]))  # only undecided features need them

    def judged(feature: Feature) -> Certified:
        lost = [row for row in feature.rows.tolist() if row in unknown]
        postures = [] if lost else [choices[row] for row in feature.rows.tolist()]
        count = math.prod(map(len, postures))
        if lost or count > _MOST_POSTURES:
            nothing = Judged(None, None, None, "undecided")
            why = unknown[lost[0]] if lost else f"{count} combinations of postures are possible"
            return Certified(feature, nothing, nothing, None, None, why)
        every = [in_posture(feature, np.array(rows)) for rows in product(*postures)]
        return every[0] if count == 1 else _in_all_postures(every)

    def in_posture(feature: Feature, rows: Integers) -> Certified:
        why = next((f"outside the measured region: {outside[row]}" for row in rows.tolist() if row in outside), "")
        is_known, why = not why, why or unmeasured
        q, poses, nominal = at.q[rows], at.wanted[rows], at.wanted[rows, :3, 3]
        before, after, cause = _drawn(feature, nominal, causes, rows, is_corrected=listed.is_corrected)
        now, corrected = (_judged(feature, nominal, moved, why, is_known=is_known) for moved in (before, after))
        proposed = None
        if not is_known:
            proposed = NextReading(poses_at(q[~inside[rows]])[0])
        elif now.verdict == "undecided" and not unmeasured and certain[rows].all():
            proposed = readings().best_for(
                np.cumsum(certain)[rows] - 1, nominal, partial(feature.values, nominal), after - nominal
            )
        of_feature, few = Work(q, poses, at.came_from[rows], at.load_kg[rows]), before[:_DRAWS_OF_CAUSE] - nominal
        days = (until(rig, drift, of_feature, few, partial(_inside, feature, nominal)) for drift in drifts if is_known)
        first = min(filter(None, days), key=lambda one: one.date, default=None)
        return Certified(feature, now, corrected, cause, proposed, why, first)

    return [judged(feature) for feature in features]


_MOST_POSTURES = 64
"""Largest number of combinations of postures that are judged: two targets with eight postures each. Chosen."""


def _with_postures(listed: Listed) -> tuple[Work, dict[int, list[int]]]:
    """The known targets followed by their other possible postures, and the rows of each target in them."""
    work, several = listed.work, listed.postures.several if listed.postures else {}
    known = [row for row in range(len(work.q)) if row not in listed.unknown]
    rows, q, choices = list(known), [work.q[known]], {row: [k] for k, row in enumerate(known)}
    for row, postures in several.items():
        choices[row] += range(len(rows), len(rows) + len(postures) - 1)
        rows += [row] * (len(postures) - 1)
        q.append(postures[1:])
    came_from = work.came_from[rows]
    came_from[len(known) :] = np.nan
    return Work(np.concatenate(q), work.wanted[rows], came_from, work.load_kg[rows]), choices


def _in_all_postures(every: Sequence[Certified]) -> Certified:
    """Judge a feature from its verdict in each possible posture. `rig correct` leaves such targets unchanged."""
    verdicts = {one.now.verdict for one in every}
    if verdicts in ({"accept"}, {"reject"}):
        side = 1 if verdicts == {"accept"} else -1
        margins = [(side * (one.now.probability or 0.0), -side * abs(one.now.expected_mm or 0.0)) for one in every]
        closest = every[margins.index(min(margins))]
        return replace(closest, corrected=closest.now)
    sizes = [one.now.expected_mm for one in every if one.now.expected_mm is not None]
    range_mm = min(sizes), max(sizes)
    nothing = Judged(None, None, None, "undecided")
    what = f"{len(every)} postures are possible, in which the error is {range_mm[0]:z.2f} to {range_mm[1]:z.2f} mm"
    return Certified(every[0].feature, nothing, nothing, None, None, what, range_mm=range_mm)


def _drawn(
    feature: Feature, nominal: Array, causes: Sequence[Cause], rows: Integers, *, is_corrected: bool
) -> tuple[Array, Array, str | None]:
    """Draws (d, m, 3) mm of the positions now and after a correction, and the cause whose absence would reduce the risk
    most.
    """
    rng = np.random.default_rng(0)
    drawn = [cause.draw(rows, _DRAWS, rng) for cause in causes]
    means = [cause.mean[rows] if cause.nature == "correctable" else np.zeros_like(nominal) for cause in causes]
    after = nominal + sum(drawn) - sum(means)
    before = after if is_corrected else after + sum(means)
    few, removed = before[:_DRAWS_OF_CAUSE], zip(drawn, means, strict=True)
    rest = [few - part[:_DRAWS_OF_CAUSE] + (mean if is_corrected else 0.0) for part, mean in removed]
    risks = [_risk(feature, nominal, moved) for moved in rest]
    cause = causes[int(np.argmin(risks))].name if min(risks) < _risk(feature, nominal, few) else None
    return before, after, cause


def _judged(feature: Feature, nominal: Array, moved: Array, why: str, *, is_known: bool) -> Judged:
    values = feature.values(nominal, moved)
    expected = float(values.mean())
    if not is_known:
        return Judged(expected, None, None, "undecided")
    probability = float(np.mean(np.abs(values) <= feature.tolerance_mm))
    verdict: Verdict = "accept" if probability >= 1 - RISK else "reject" if probability <= RISK else "undecided"
    return Judged(expected, float(values.std()), probability, "undecided" if why else verdict)


def _inside(feature: Feature, nominal: Array, moves: Array) -> float:
    return float(np.mean(np.abs(feature.values(nominal, nominal + moves)) <= feature.tolerance_mm))


def _risk(feature: Feature, nominal: Array, moved: Array) -> float:
    """Share of draws outside, and among equal shares the mean square error in tolerances."""
    values = feature.values(nominal, moved) / feature.tolerance_mm
    return float(np.mean(np.abs(values) > 1)) + 1e-6 * float(np.mean(values**2))
