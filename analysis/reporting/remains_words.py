"""What stays after the calibrated model, in words: what it was held against, and what was not found."""

from __future__ import annotations

from analysis.inference.result import Remains
from analysis.reporting.diagnosis_words import micrometres, percent
from analysis.reporting.texts import Texts

_FOUND = 0.02
"""Share from which something counts as found: the strength is chosen by what is left out, which flatters a little."""


def remains_lines(remains: Remains, texts: Texts) -> list[str]:
    """Return what stays at places left out, and what it goes with or does not."""
    looked = {one.subject: one.share for one in remains.looked if one.share is not None}
    shares = [f"{texts(f'remains_{subject}')} {percent(share)}" for subject, share in looked.items() if share >= _FOUND]
    none = [texts(f"remains_{subject}") for subject, share in looked.items() if share < _FOUND]
    lines = [texts("remains", um=micrometres(remains.um), noise=micrometres(remains.noise_um))]
    found = texts("remains_found", shares=", ".join(shares)) if shares else ""
    against = texts("remains_none", subjects=", ".join(none)) if none else ""
    return [*lines, " ".join(filter(None, (found, against)))]


def remains_rows(remains: Remains, texts: Texts) -> list[tuple[str, str]]:
    """Return a row for each thing that it was held against: what, and the share that it explains, or why it has
    none."""
    return [
        (
            texts(f"remains_{one.subject}"),
            texts("remains_unknown") if one.share is None else percent(one.share) if one.share >= _FOUND else
            texts("remains_nothing"),
        )
        for one in remains.looked
    ]  # fmt: skip
