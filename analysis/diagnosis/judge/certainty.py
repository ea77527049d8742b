"""Certainty of the causes and parts of a diagnosis: likely rivals, open causes, certain contributions."""

from __future__ import annotations

from analysis.diagnosis.evidence.significance import CERTAIN_SIGMA, ODDS, SURE_SIGMA
from analysis.diagnosis.judge.probability import CONFIRMED
from analysis.diagnosis.judge.result import LARGE_SHARE, PRESENT, BudgetPart, Diagnosis, Named, Rival
from rigs.calibration import verdict_of


def likely_rivals(named: Named) -> list[Rival]:
    return [rival for rival in named.rivals if rival.probability * ODDS >= named.probability]


def fault_rivals(named: Named) -> list[Rival]:
    """The rivals of an effect of usual size that cannot be dismissed and would be faults."""
    return [rival for rival in likely_rivals(named) if rival.is_fault and named.doubt == "usual"]


def is_open(part: BudgetPart, named: Named) -> bool:
    """Whether the cause of a large share of the error is undecided: the effect is no fault, or usual errors may have
    the same result, and it is not certain.
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


def is_certain_cause(diagnosis: Diagnosis, named: Named) -> bool:
    """True if an effect certainly exists, has no likely rival, and no unknown cause may imitate it."""
    is_named = named.probability >= CONFIRMED and not likely_rivals(named) and named.doubt in PRESENT
    return is_named and (diagnosis.condition != "outside_library" or outweighs_unexplained(diagnosis, named))


def is_certain_part(diagnosis: Diagnosis, part: BudgetPart) -> bool:
    """Whether the contribution of a part is certain, even if several similar effects may be the cause."""
    named = diagnosis.named_of(part)
    if named is None:
        return part.sigma >= CERTAIN_SIGMA
    # If usual errors may have the same result, the cause is undecided and the contribution certain. The contribution is
    # also certain if only the size is uncertain, such as order and amplitude of a wave over a small range.
    is_there = named.doubt in (None, "usual", "healthy_shows_it")
    is_there |= named.doubt == "unsure" and named.probability >= CONFIRMED
    return is_there and part.sigma >= SURE_SIGMA


def is_sure(diagnosis: Diagnosis, part: BudgetPart) -> bool:
    named = diagnosis.named_of(part)
    return (named is None or named.probability >= CONFIRMED) and is_certain_part(diagnosis, part)
