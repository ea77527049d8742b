"""Runs laid about the model of one rig, whatever their own rig files say of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from analysis.diagnosis.exchanged import exchanged
from analysis.diagnosis.observed import Seen, see
from analysis.fitting.observation import with_placement
from analysis.fitting.placements import parted, with_enough
from analysis.model.predict import model_of
from analysis.traces.loading import Measured
from analysis.traces.tables import CircleTable, Table
from rigs.errors import FileError
from rigs.rig import Rig

_FEW = 1e-3
"""Share of wild readings that is not told: where a play is crossed, some sound ones are taken for wild."""


def about(rig: Rig, *uses: Sequence[Measured]) -> tuple[list[list[Seen]], list[str]]:
    """The runs of each use as a diagnosis sees them, with the circle and targets of their own rig files; and what they
    show of where they stand and how they are wired, in words.

    All runs of one cell and placement share a set-up and its name, whatever they are used for. Left out are those whose
    gauges are exchanged, and those of a set-up that takes up all their readings. Raises FileError for a run of another
    robot.
    """
    runs = [run for use in uses for run in use]
    names = [run.run.manifest.name for run in runs]
    use_of = [number for number, use in enumerate(uses) for _ in use]
    seen = _laid(rig, runs)
    wrong = exchanged(seen)
    kept = [k for k in range(len(runs)) if k not in wrong]
    found, told = _parted([seen[k] for k in kept], [names[k] for k in kept])
    for k in wrong:
        what = f"{names[k]} is left out: its gauges read as g1 and g2 exchanged, against its repeats"
        told.insert(0, f"{what}; see the cables, or import it with the columns exchanged")
    told += _wild([(names[k], seen[k].wild, runs[k].table) for k in kept])
    parts = []
    for number in range(len(uses)):
        own = [run for k, run in zip(kept, found, strict=True) if use_of[k] == number]
        enough, too_few = with_enough([run.one for run in own]) if own else ([], [])
        parts.append([own[k] for k in enough])
        told += too_few
    return parts, told


def _wild(counted: Sequence[tuple[str, int, Table]]) -> list[str]:
    """How many readings of circles are wild, in words, from the name, wild readings and table of each run."""
    circles = [(name, wild, table.g_mm.size) for name, wild, table in counted if isinstance(table, CircleTable)]
    wild, readings = sum(one[1] for one in circles), sum(one[2] for one in circles)
    if wild <= _FEW * readings:
        return []
    most = max(circles, key=lambda one: one[1])
    what = f"{wild} of {readings} readings of circles are wild and follow their neighbours"
    return [f"{what} (most, {most[1]}, in {most[0]})"]


def _laid(rig: Rig, runs: Sequence[Measured]) -> list[Seen]:
    """Runs about a rig with the circle and targets of their own, set-ups named by test, placement and cell."""
    cells: list[Rig] = []
    seen: list[Seen] = []
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


def _parted(seen: Sequence[Seen], names: Sequence[str]) -> tuple[list[Seen], list[str]]:
    """Runs with a set-up for each frame that those of a set-up show, and what was found, in words."""
    found, told = list(seen), []
    for setup in dict.fromkeys(run.one.setup for run in seen):
        places = [k for k, run in enumerate(seen) if run.one.setup == setup]
        own, words = parted(seen[places[0]].model, [seen[k].one for k in places], [names[k] for k in places])
        for k, one in zip(places, own, strict=True):
            found[k] = replace(seen[k], one=one)
        told += words
    return found, told


def refuse_copies(runs: Sequence[Measured]) -> None:
    """Raises FileError where two runs hold the same readings.

    As a repeat a copy would tell of no noise at all, and as a run left out it would judge by what was used.
    """
    known: dict[tuple[str, ...], Measured] = {}
    for run in runs:
        chunks = tuple(chunk.sha256 for chunk in run.run.manifest.chunks)
        if first := known.get(chunks):
            raise FileError(str(run.path), f"holds the same readings as {first.path}", "give each recording once")
        known[chunks] = run


def _differing(one: Rig, other: Rig) -> str:
    fields = [name for name in type(one.robot).model_fields if getattr(one.robot, name) != getattr(other.robot, name)]
    return f"its {', '.join(fields)} differ{'s' * (len(fields) == 1)}"
