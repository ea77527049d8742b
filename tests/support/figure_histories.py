"""Histories of the figures of two robots: of one a play grows, the other stays as it is.

`tests/tables/histories.json` has them as a world drew them that knows nothing of the search for changes: visits over
months, with heavy tails, a scatter of each mounting, of weather and season, warm-up, coarse resolution and outliers.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from analysis.apps.plant.collect import Collected
from analysis.apps.plant.records import RunRecord
from analysis.procedures.shared.quantity import Quantity
from rigs.schema.limits import Limits

_FILE = Path(__file__).parents[1] / "tables" / "histories.json"


def _records(tests: dict[str, dict[str, list[str]]]) -> list[RunRecord]:
    """Runs in order of time, with one run of each test at each visit."""
    found = []
    for label, test in tests.items():
        for visit, started in enumerate(test["when"]):
            quantities = {
                name: Quantity(of["values"][visit], of["u"], name.rsplit("_", 1)[1])  # type: ignore[call-overload]
                for name, of in test["figures"].items()  # type: ignore[attr-defined]
            }
            name = f"{visit:04d}-{label.replace(' ', '-')}"
            found.append(RunRecord(name, name, "ur10e", started, *label.split(), "", figures=quantities))
    return sorted(found, key=lambda run: run.started)


GREW, STILL = map(_records, json.loads(_FILE.read_text(encoding="ascii")).values())
"""The play of axis 2 grew at visit 40 of 75; 40 visits without a change."""


def collected(runs: Sequence[RunRecord], limits: Limits | None = None) -> Collected:
    """Return runs as read from a directory, with the limits of their rig file."""
    return Collected("ur10e", tuple(runs), (), (), limits or Limits())
