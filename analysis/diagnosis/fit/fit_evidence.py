"""Second stage of a diagnosis: the effects that explain the evidence, by a search or as given."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from analysis.diagnosis.evidence.gather import Evidence
from analysis.diagnosis.fit.out_of_range import OutOfRange, find_out_of_range
from analysis.diagnosis.fit.search import SearchResult, fit_given, search
from rigs.effects import Effect


@dataclass(frozen=True)
class Fit:
    """Fitted effects. is_given: by the user, not found by a search. out_of_range: the parameter that exceeds its
    range.
    """

    result: SearchResult
    out_of_range: OutOfRange | None = None
    is_given: bool = False


def fit_evidence(evidence: Evidence, given: Sequence[Effect] | None, progress: Callable[[str], None]) -> Fit:
    """Search for effects, or fit the `given` ones. If a search finds a parameter out of range, only this is fitted,
    without a limit.
    """
    if given is not None:
        return Fit(fit_given(evidence.runs, given, progress), is_given=True)
    result = search(evidence.runs, progress)
    beyond = find_out_of_range(result, evidence.runs)
    if beyond is None:
        return Fit(result)
    return Fit(fit_given(evidence.runs, [beyond.effect], progress, frozenset({beyond.name})), beyond)
