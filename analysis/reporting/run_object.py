"""What scripts read of analysed runs: the JSON object, and figures beside the truth that an emulated cell wrote down
(`truth.json`). Nothing of a screen is imported for it.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from analysis.frames import for_json
from analysis.measures.pooled import BetweenRuns, Pooled, pairs_of, pooled
from analysis.measures.quantity import Quantity
from analysis.measures.results import Result, by_test
from analysis.reporting.run_words import what_u_is
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


def as_object(results: Sequence[Result], truths: Sequence[dict[str, TruthComparison]] = ()) -> dict[str, Any]:
    """The same for scripts; angles in degrees, lengths in mm, u the standard uncertainty, null where it is unknown."""
    runs = [result.to_dict() for result in results]
    for run, truth in zip(runs, truths, strict=False):
        run["truth"] = {name: asdict(comparison) for name, comparison in truth.items()}
    groups = by_test(results)
    plain: dict[str, Any] = for_json(
        {
            "runs": runs,
            "between_runs": [_pooled_object(runs_mean) for group in groups for runs_mean in pooled(group)],
            "remarks": [
                what_u_is(group, [runs_mean for runs_mean in pooled(group) if runs_mean.figures]) for group in groups
            ],
            "acw_against_cw": [
                {
                    "rig": group[0].measured.rig.name,
                    "test": group[0].test,
                    "runs": [str(result.measured.path) for acw_and_cw in both.runs for result in acw_and_cw],
                    "figures": {name: _between_object(figure) for name, figure in both.figures.items()},
                    "lag": None if both.lag is None else asdict(both.lag),
                    "refused": list(both.refused),
                }
                for group in groups
                if (both := pairs_of(group))
            ],
        }
    )
    return plain


def _pooled_object(runs_mean: Pooled) -> dict[str, Any]:
    """u of the mean, sd between the runs: what no single run can show."""
    every = runs_mean.runs or tuple(result for result, _ in runs_mean.left_out)
    return {
        "rig": every[0].measured.rig.name,
        "test": every[0].test,
        "direction": every[0].measured.run.manifest.direction,
        "runs": [str(result.measured.path) for result in runs_mean.runs],
        "left_out": {str(result.measured.path): why for result, why in runs_mean.left_out},
        "figures": {name: _between_object(figure) for name, figure in runs_mean.figures.items()},
    }


def _between_object(figure: BetweenRuns | Quantity) -> dict[str, Any]:
    if isinstance(figure, Quantity):
        return asdict(figure)
    return asdict(figure.mean) | {"sd_between_runs": figure.sd, "runs": figure.runs}
