"""What scripts read of analysed runs: the JSON object. Nothing of a screen is imported for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from analysis.frames import for_json
from analysis.measures.pooled import BetweenRuns, Pooled, pairs_of, pooled
from analysis.measures.quantity import Quantity
from analysis.measures.results import Result, by_test
from analysis.reporting.run_words import what_u_is
from analysis.reporting.truth import TruthComparison


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
