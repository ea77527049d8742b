"""The error of a robot before and after its correction: what it was, is, was expected to be, and over the work."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from analysis.correction.deviation import Deviation, Side
from analysis.reporting.page.verdict import Verdict


@dataclass(frozen=True)
class BeforeAfter:
    """What was corrected, by what, and the error before and after on the same circle and at the other place.

    way: the tense and the words of the page follow from it. work: the error over the work of the rig file without and
    with the correction, and the standard uncertainty of the model there, µm rms, None where nothing was corrected.
    judged: what the other place said of the model before its runs joined the last diagnosis, µm rms before and with it;
    None where none judged. verdict: the figures of the runs afterwards against their limits, on the same circle, None
    where there were no such runs. own_programs: the command that corrects programs of the reader's own.
    """

    correction: str
    way: Literal["entries", "programs", "none"]
    rows: tuple[Side, ...]
    work: tuple[float, float, float] | None = None
    judged: tuple[float, float] | None = None
    joined: int = 0
    own_programs: str = ""
    verdict: Verdict | None = None

    @property
    def driven(self) -> tuple[Deviation, Deviation] | None:
        """The error before and after on the same circle; None where nothing was driven afterwards."""
        return next(((row.before, row.after) for row in self.rows if row.place == "same" and row.after), None)

    @property
    def elsewhere(self) -> tuple[Deviation, Deviation] | None:
        """The same at the other place."""
        return next(((row.before, row.after) for row in self.rows if row.place == "elsewhere" and row.after), None)
