"""Runs after a repair against runs before it: the difference of each figure, and whether the spread explains it.

The spread between runs is pooled over both sides, and with that of the robot's history where the runs lie beside one:
two runs a side hardly show it. A difference then has Student's law, and 2 u hold 95.45 % of it. As many figures are
compared, the probability that a repair that does nothing seems to do something is shared among them (Bonferroni).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from analysis.frames import for_json
from analysis.history.changes import FALSE_ALARMS, trend_of
from analysis.history.history import WATCHED, label_of, title_of
from analysis.history.history_file import FILE, Unusable, read_records
from analysis.history.records import Record, fingerprint_of, in_time, record_of
from analysis.measures.quantity import Quantity, student_factor
from analysis.traces.loading import refuse_copies
from daq.store import load_manifest
from rigs.errors import FileError

_FEWEST_OF_HISTORY = 10
"""Runs of a series from which its history shows a spread; fewer add nothing to the runs that are compared."""
_EFFICIENCY = 0.37
"""A median of absolute deviations is as good as a standard deviation of this share of the runs (normal law)."""
Key = tuple[str, str, str, str]


@dataclass(frozen=True)
class Difference:
    """A figure of one test before and after. difference: after less before, u infinite where no spread is known;
    explained: the largest difference that the spread between runs explains, infinite where none is known; runs_before,
    runs_after: how many."""

    title: str
    figure: str
    before: float
    after: float
    difference: Quantity
    explained: float
    runs_before: int
    runs_after: int

    @property
    def is_larger(self) -> bool:
        """Whether the difference is more than the spread between runs explains."""
        return abs(self.difference.value) > self.explained

    @property
    def sentence(self) -> str:
        """What changed and whether that is more than the spread, in words."""
        one = self.difference
        if not np.isfinite(one.u):
            return f"{self._what} went from {one.rounded(self.before)} to {one.rounded(self.after)} {one.sign}; " + (
                "a single run on either side shows no spread: repeat them."
            )
        verb = "rose" if one.value > 0 else "fell"
        than = "more than" if self.is_larger else "within"
        return (
            f"{self._what} {verb} from {one.rounded(self.before)} to {one.rounded(self.after)} {one.sign}, "
            f"by {one.rounded(abs(one.value))} ± {one.rounded_u} {one.sign}: {than} the "
            f"{one.rounded(self.explained)} {one.sign} that the spread between runs explains."
        )

    @property
    def _what(self) -> str:
        words = label_of(self.figure)
        return f"{words[0].upper()}{words[1:]} of {self.title}"

    def to_dict(self) -> dict[str, Any]:
        """The same for scripts, with its sentence; u is null where no spread is known."""
        plain: dict[str, Any] = for_json(asdict(self) | {"is_larger": self.is_larger, "sentence": self.sentence})
        return plain


def headlines(found: Sequence[Difference]) -> list[str]:
    """What is said first: a sentence for each figure that changed, or why there is none; and what is not known."""
    larger = [one.sentence for one in found if one.is_larger]
    unknown = sum(not np.isfinite(one.difference.u) for one in found)
    repeat = "record two or more runs on at least one side."
    if unknown == len(found):
        return [f"The spread between runs is not known, so no difference can be judged: {repeat}"]
    none = ["No figure differs by more than the spread between runs explains."]
    rest = [f"Figures without a known spread between runs, not judged: {unknown}; {repeat}"] if unknown else []
    return [*(larger or none), *rest]


def differences(after: Sequence[Path], before: Sequence[Path]) -> list[Difference]:
    """The differences of all figures that runs on both sides have, by test and program.

    Raises FileError for a run that has no figures or whose readings are given twice, for runs of different robots, and
    where the sides have no test in common.
    """
    _hold_apart(after, before)
    known = _known(Path(run).parent for run in (*before, *after))
    now, then = ([_record(run, known) for run in side] for side in (after, before))
    records = zip((*before, *after), (*then, *now), strict=True)
    refuse_copies((path, record.readings) for path, record in records)
    robots = sorted({record.rig for record in (*now, *then)})
    if len(robots) > 1:
        raise FileError(" and ".join(robots), "are different robots", "compare runs of one robot")
    groups: list[tuple[Key, list[Record], list[Record]]] = [
        (key, [one for one in then if _key(one) == key], [one for one in now if _key(one) == key])
        for key in dict.fromkeys(map(_key, now))
    ]
    picked = [(key, name, b, a) for key, b, a in groups if b for name in WATCHED if _all_have(name, [*b, *a])]
    if not picked:
        what = "both sides have no test, direction, placement and program in common"
        raise FileError("--against", what, "give runs of one test on both sides")
    return [_difference(key, name, b, a, len(picked), known) for key, name, b, a in picked]


def _hold_apart(after: Sequence[Path], before: Sequence[Path]) -> None:
    both = {path.resolve() for path in after} & {path.resolve() for path in before}
    for path in sorted(both):
        raise FileError(str(path), "is on both sides", "give it before --against or after it")


def _known(directories: Iterable[Path]) -> dict[Path, dict[str, Record]]:
    """What the histories beside the runs hold."""
    found: dict[Path, dict[str, Record]] = {}
    for directory in dict.fromkeys(path.resolve() for path in directories):
        with suppress(Unusable):
            found[directory] = read_records(directory / FILE)[0]
    return found


def _record(run: Path, known: dict[Path, dict[str, Record]]) -> Record:
    """The record of a run, from the history beside it where that is up to date."""
    path = run.resolve()
    manifest = load_manifest(path)
    try:
        fingerprint = fingerprint_of(path)
    except OSError as error:
        raise FileError(str(path), error.strerror or str(error), "check the disk and the rights") from None
    record = known.get(path.parent, {}).get(path.name)
    if record is None or record.fingerprint != fingerprint:
        record = record_of(path, manifest, fingerprint)
    if record.problem:
        raise FileError(str(run), record.problem, "leave it out, or see rig verify")
    return record


def _key(record: Record) -> Key:
    return record.title, record.placement, record.program, record.corrected


def _all_have(figure: str, records: Sequence[Record]) -> bool:
    return all(figure in record.figures and np.isfinite(record.figures[figure].value) for record in records)


def _difference(
    key: Key,
    figure: str,
    before: Sequence[Record],
    after: Sequence[Record],
    count: int,
    known: dict[Path, dict[str, Record]],
) -> Difference:
    from scipy.special import stdtrit  # noqa: PLC0415 - slow to import

    sides = [np.array([record.figures[figure].value for record in side]) for side in (before, after)]
    then, now = (float(side.mean()) for side in sides)
    freedom = float(sum(len(side) - 1 for side in sides))
    squares = float(sum(((side - side.mean()) ** 2).sum() for side in sides))
    spread, of_history = _spread_of_history(key, figure, known)
    freedom, squares = freedom + of_history, squares + of_history * spread**2
    unit = before[0].figures[figure].unit
    u = limit = np.inf
    if freedom > 0:
        error = float(np.sqrt(squares / freedom * sum(1 / len(side) for side in sides)))
        u = error * student_factor(freedom)
        limit = error * float(stdtrit(freedom, 1 - FALSE_ALARMS / count / 2))
    difference = Quantity(now - then, u, unit)
    return Difference(title_of(key[0], key[1], key[3]), figure, then, now, difference, limit, len(before), len(after))


def _spread_of_history(key: Key, figure: str, known: dict[Path, dict[str, Record]]) -> tuple[float, float]:
    """Standard deviation from run to run in the longest history, and its degrees of freedom; 0 and 0 without one."""
    best: list[Record] = []
    for records in known.values():
        own = [one for one in records.values() if not one.problem and _key(one) == key and _all_have(figure, [one])]
        best = max(best, own, key=len)
    if len(best) < _FEWEST_OF_HISTORY:
        return 0.0, 0.0
    quantities = [record.figures[figure] for record in in_time(best)]
    u = np.nan_to_num(np.array([one.u for one in quantities]), posinf=0.0)
    trend = trend_of(np.array([one.value for one in quantities]), u, 1)
    return trend.spread, _EFFICIENCY * (len(best) - 1) if trend.spread > 0 else 0.0
