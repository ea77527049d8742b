"""What a diagnosis that says *correct nothing* means for a correction: it is refused, or written and marked.

The verdict stands in the calibration file (`rigs.calibration.verdict_of`); here are its words and its consequence.
"""

from __future__ import annotations

from rigs.calibration import ground_of, verdict_of
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.text import as_argument

ANYWAY = "written although rig says: correct nothing by this model"
"""What every file says that was written against the verdict."""


def why_nothing(rig: Rig) -> str:
    """Return why a rig's model corrects nothing, as a sentence; empty where it may correct."""
    if rig.calibrated is None or verdict_of(rig.calibrated) == "correct":
        return ""
    judged = rig.calibrated.judged
    assert judged is not None  # noqa: S101 - without it the verdict is to correct
    why = "correct nothing by this model:"
    if ground_of(rig.calibrated) == "not_shown":
        return f"{why} its runs cannot show what is wrong, and what it leaves elsewhere is not known"
    remainder = f"it leaves {judged.handed_um:.0f} of {judged.before_um:.0f} µm rms"
    if ground_of(rig.calibrated) == "no_gain_elsewhere":
        return f"{why} where it had no part {remainder}, no less than without it"
    where = "on the runs used, and none judged it elsewhere" if judged.place == "used" else "where it had no part"
    return f"{why} a cause that is in no library remains, {judged.unexplained_um:.0f} µm; {remainder} {where}"


def hold_verdict(rig: Rig, rig_file: str, *, anyway: bool) -> None:
    """Raise FileError where a rig's model corrects nothing, unless it is to be written `anyway`."""
    if (why := why_nothing(rig)) and not anyway:
        remedy = (
            f"see what to measure next with rig plan {as_argument(rig_file)}; --anyway writes it, and the files say so"
        )
        raise FileError(rig_file, why, remedy)
