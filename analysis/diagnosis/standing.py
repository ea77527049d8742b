"""The standing of runs against the limits of their rig file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from analysis.measures.results import result_of
from analysis.traces.loading import Measured
from rigs.errors import RigError
from rigs.rig import Rig
from rigs.schema.limits import Standing

_WORST: tuple[Standing, ...] = ("fail", "watch", "pass")


def standing_of(rig: Rig, runs: Sequence[Measured]) -> tuple[Standing | None, Literal["rig_file", "data_sheet"] | None]:
    """Return the worst standing of the figures of runs that have a limit, and where that comes from; None and None
    where none of them has one. Runs that cannot be evaluated have no figures."""
    found: list[tuple[Standing, Literal["rig_file", "data_sheet"]]] = []
    for run in runs:
        test = run.run.manifest.test
        try:
            figures = result_of(run).figures
        except RigError:
            continue
        for name, figure in figures.items():
            if limit := rig.limits.of(test, name):
                of: Literal["rig_file", "data_sheet"] = (
                    "data_sheet" if rig.limits.from_data_sheet(test, name) else "rig_file"
                )
                found.append((limit.standing(figure.value, figure.u), of))
    return min(found, key=lambda one: _WORST.index(one[0])) if found else (None, None)
