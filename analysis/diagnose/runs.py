"""Runs laid about the model of one rig, whatever their own rig files say of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from analysis.diagnose.observed import Seen, see
from analysis.fitting.observation import with_placement
from analysis.model.predict import model_of
from analysis.reading.loading import Measured
from rigs.errors import FileError
from rigs.rig import Rig


def about(rig: Rig, runs: Sequence[Measured]) -> list[Seen]:
    """Each run with the circle and targets of its own rig file. Raises FileError for one of another robot."""
    seen: list[Seen] = []
    cells: list[Rig] = []
    for run in runs:
        if run.rig.robot != rig.robot:
            raise FileError(
                str(run.path),
                f"is of another robot than {rig.name} ({_differing(run.rig, rig)})",
                "diagnose the runs of one robot at a time, or give the --rig that they were made with",
            )
        cell = run.rig.model_copy(update={"effects": rig.effects, "name": rig.name, "description": ""})
        if cell not in cells:
            cells.append(cell)
        one = see(model_of(cell), run.table, str(run.path))
        placed = with_placement(one.one, run.run.manifest.placement)
        place = cells.index(cell)
        # Another circle or other gauges are another set-up.
        setup = placed.setup + f" {place + 1}" * (place > 0)
        seen.append(replace(one, one=replace(placed, setup=setup)))
    return seen


def refuse_copies(runs: Sequence[Measured]) -> None:
    """Raises FileError where two runs hold the same readings.

    As a repeat a copy would tell of no noise at all, and as a run left out it would judge by what was used.
    """
    known: dict[tuple[str, ...], Measured] = {}
    for run in runs:
        first = known.setdefault(tuple(chunk.sha256 for chunk in run.run.manifest.chunks), run)
        if first is not run:
            raise FileError(str(run.path), f"holds the same readings as {first.path}", "give each recording once")


def _differing(one: Rig, other: Rig) -> str:
    fields = [name for name in type(one.robot).model_fields if getattr(one.robot, name) != getattr(other.robot, name)]
    return f"its {', '.join(fields)} differ{'s' * (len(fields) == 1)}"
