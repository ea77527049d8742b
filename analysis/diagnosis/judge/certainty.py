"""Certainty of the causes and parts of a diagnosis.

A part of the error may have a certain contribution, whatever its cause (`has_certain_contribution`), also a certain
name (`has_certain_name`), and also no rival, known or unknown (`is_certain_cause`).
"""

from __future__ import annotations

from analysis.diagnosis.evidence.significance import CERTAIN_SIGMA, ODDS, SURE_SIGMA
from analysis.diagnosis.judge.budget_part import LARGE_SHARE, BudgetPart
from analysis.diagnosis.judge.named import PRESENT, Named, Rival
from analysis.diagnosis.judge.probability import CONFIRMED
from analysis.diagnosis.judge.result import Diagnosis
from rigs.calibration import verdict_of


def likely_rivals(named: Named) -> list[Rival]:
    return [rival for rival in named.rivals if rival.probability * ODDS >= named.probability]


def fault_rivals(named: Named) -> list[Rival]:
    """Likely rivals of an effect of usual size that would be faults."""
    return [rival for rival in likely_rivals(named) if rival.is_fault and named.doubt == "usual"]


def is_open(part: BudgetPart, named: Named) -> bool:
    """True if the cause of a large part of the error is undecided: the effect is usual or usual errors imitate it, and
    it is not certain.
    """
    return part.share > LARGE_SHARE and named.doubt in ("usual", "healthy_shows_it") and named.probability < CONFIRMED


OUTWEIGHS = 4.0
"""Ratio to the unexplained error from which a name is believed beside it. Source: of 24 cells with an unknown cause, 15
had a wrong name, and 2 a wrong name that explained four times the unexplained error.
"""


def outweighs_unexplained(diagnosis: Diagnosis, named: Named) -> bool:
    """True if an effect explains much more than remains unexplained, and its model holds at the validation place."""
    calibrated = diagnosis.calibrated
    is_valid = calibrated is not None and verdict_of(calibrated) != "nothing"
    return is_valid and named.contribution_um >= OUTWEIGHS * diagnosis.residual.um


def has_certain_contribution(diagnosis: Diagnosis, part: BudgetPart) -> bool:
    """True if the contribution of a part is certain, even if several similar effects may be the cause."""
    named = diagnosis.named_of(part)
    if named is None:
        return part.sigma >= CERTAIN_SIGMA
    # If usual errors may have the same result, the cause is undecided and the contribution certain. The contribution is
    # also certain if only the size is uncertain, such as order and amplitude of a wave over a small range.
    is_there = named.doubt in (None, "usual", "healthy_shows_it")
    is_there |= named.doubt == "unsure" and named.probability >= CONFIRMED
    return is_there and part.sigma >= SURE_SIGMA


def has_certain_name(diagnosis: Diagnosis, part: BudgetPart) -> bool:
    """True if the contribution of a part is certain, and the effect that causes it; a group needs no effect."""
    named = diagnosis.named_of(part)
    return (named is None or named.probability >= CONFIRMED) and has_certain_contribution(diagnosis, part)


def is_certain_cause(diagnosis: Diagnosis, named: Named) -> bool:
    """True if an effect certainly exists, has no likely rival, and no unknown cause can imitate it."""
    is_named = named.probability >= CONFIRMED and not likely_rivals(named) and named.doubt in PRESENT
    return is_named and (diagnosis.condition != "outside_library" or outweighs_unexplained(diagnosis, named))
