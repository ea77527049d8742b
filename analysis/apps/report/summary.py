"""Summary of a diagnosis in three tiles, for page, window, terminal and picture: error, main causes, next step."""

from __future__ import annotations

from dataclasses import dataclass, replace

from analysis.apps.report.blocks import BadgeTone, BarSegment
from analysis.apps.report.diagnosis_words import error_size
from analysis.apps.report.texts import Phrase, Texts, joined, keys_of
from analysis.correction.deviation import Deviation


@dataclass(frozen=True)
class ErrorChange:
    now_label: str
    now: str
    after_label: str
    after: str
    basis: str
    standing: str = ""

    @property
    def words(self) -> str:
        return f"{self.now} → {self.after} µm rms" if self.after else f"{self.now} µm rms"

    @property
    def title(self) -> str:
        label = f"{self.now_label} → {self.after_label}" if self.after else self.now_label
        return label[:1].upper() + label[1:]

    def with_remarks(self, texts: Texts, *, is_measured: bool) -> ErrorChange:
        remarks = ["noise_assumed"] * (not is_measured) + ["error_bounded"] * ("<" in self.words)
        return replace(self, basis=joined([self.basis, *map(texts, remarks)]))


@dataclass(frozen=True)
class Summary:
    """standing: condition of the badge, after `moved` and `contradicted`. unknowns: limits of the evidence."""

    badge: str
    standing: str
    headline: str
    unknowns: tuple[str, ...]
    error: ErrorChange
    causes: tuple[BarSegment, ...]
    next: str
    command: str = ""
    """One or more lines."""
    tone: BadgeTone = "unjudged"
    action: str = ""
    """The next step in a few words, at the end of the first sentence."""


def with_action(sentence: str, action: str) -> str:
    keys = (*keys_of(sentence), *keys_of(action))
    return Phrase(f"{sentence.removesuffix('.')}; {action}.", keys) if action else sentence


def with_next(summary: Summary, step: str, command: str, action: str) -> Summary:
    headline = summary.headline.replace(f"; {summary.action}.", f"; {action}." if action else ".", 1)
    return replace(summary, headline=headline, next=step, command=command, action=action)


_CHANGES_ARM = ("repair", "remaster", "enter", "check")


def with_corrections_removed(summary: Summary, kind: str, way: str, texts: Texts) -> Summary:
    """Also remove the correction, which would correct a repaired arm twice.

    kind: of the next act. way: how the robot was corrected.
    """
    if way == "none" or kind not in _CHANGES_ARM:
        return summary
    return replace(summary, next=f"{summary.next} {texts(f'then_without_{way}')}")


WITHOUT_FAULT = ("uncalibrated", "nothing_unusual", "unusual_group", "no_certain_fault")
"""Conditions in which the limits alone decide the colour of the badge."""


def with_driven_error(summary: Summary, before: Deviation, after: Deviation, texts: Texts) -> Summary:
    """The measured error before and after a correction; the limits behind the colour applied without it."""
    error = ErrorChange(
        now_label=texts("error_before_label"),
        now=error_size(before.um, before.u_um),
        after_label=texts("error_driven_label"),
        after=error_size(after.um, after.u_um),
        basis=texts("basis_driven"),
    ).with_remarks(texts, is_measured=before.u_um > 0)
    tones: dict[str, BadgeTone] = {"unusual_group": "watch", "no_certain_fault": "unjudged"}
    tone = tones.get(summary.standing, "pass") if summary.standing in WITHOUT_FAULT else summary.tone
    return replace(summary, error=error, tone=tone)
