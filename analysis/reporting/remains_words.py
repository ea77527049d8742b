"""What stays after the calibrated model, in words: what it was held against, and what was not found."""

from __future__ import annotations

from analysis.inference.result import Remains
from analysis.reporting.diagnosis_words import micrometres, percent
from analysis.reporting.texts import Texts

_FOUND = 0.02
"""Share from which something counts as found: the strength is chosen by what is left out, which flatters a little."""


def remains_lines(remains: Remains, texts: Texts) -> list[str]:
    """Return what stays at places left out, and what it goes with or does not."""
    shares = {texts(f"remains_{looked.subject}"): looked.share for looked in remains.looked if looked.share is not None}
    shown = [f"{subject} {percent(share)}" for subject, share in shares.items() if share >= _FOUND]
    none = [subject for subject, share in shares.items() if share < _FOUND]
    goes_with = texts("remains_found", shares=", ".join(shown)) if shown else ""
    against = texts("remains_none", subjects=", ".join(none)) if none else ""
    whole = texts("remains", um=micrometres(remains.um), noise=micrometres(remains.noise_um))
    return [whole, " ".join(filter(None, (goes_with, against)))]


def remains_rows(remains: Remains, texts: Texts) -> list[tuple[str, str]]:
    """Return a row for each thing that it was held against: what, and the share that it explains, or why it has
    none."""

    def words(share: float | None) -> str:
        if share is None:
            return texts("remains_unknown")
        return percent(share) if share >= _FOUND else texts("remains_nothing")

    return [(texts(f"remains_{looked.subject}"), words(looked.share)) for looked in remains.looked]
