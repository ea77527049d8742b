"""Setting figures beside the truth that an emulated cell wrote down (`truth.json`)."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from analysis.measures.results import Result
from rigs.errors import FileError
from rigs.files import read_bytes

_MOST_BYTES = 1_000_000


@dataclass(frozen=True)
class TruthComparison:
    """One figure of one run: the truth, and how many standard uncertainties the measured one lies from it."""

    truth: float
    deviation_u: float


def compare(results: Sequence[Result], path: Path) -> list[dict[str, TruthComparison]]:
    """For each result, its figures by name beside the truth, none for a test that it lacks. Raises FileError."""
    try:
        truth = json.loads(read_bytes(path, _MOST_BYTES))
        comparisons = []
        for result in results:
            manifest = result.measured.run.manifest
            if truth["rig"] != manifest.rig_name:
                raise KeyError(manifest.rig_name)
            values = truth[manifest.test][manifest.direction] if manifest.test in truth else {}
            figures = ((name, result.figures[name], float(value)) for name, value in values.items())
            comparisons.append(
                {name: TruthComparison(true, (seen.value - true) / seen.u) for name, seen, true in figures}
            )
    except OSError as error:
        raise FileError(str(path), error.strerror or str(error), "give the truth.json that rig emulate wrote") from None
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise FileError(
            str(path), "is not the truth of these runs", "give the truth.json that rig emulate wrote"
        ) from None
    if not any(comparisons):
        raise FileError(str(path), f"does not cover the {results[0].test} test", "leave --truth out")
    return comparisons


def all_agree(comparisons: Sequence[dict[str, TruthComparison]]) -> bool:
    """Whether every figure lies within two standard uncertainties of the truth."""
    return all(abs(comparison.deviation_u) <= 2 for by_name in comparisons for comparison in by_name.values())


def verdict(comparisons: Sequence[dict[str, TruthComparison]]) -> str:
    """The number of figures that agree with the truth within two standard uncertainties, in one line."""
    every = [comparison for by_name in comparisons for comparison in by_name.values()]
    within = sum(abs(comparison.deviation_u) <= 2 for comparison in every)
    return f"{within} of {len(every)} figures agree with the truth within 2 u"
