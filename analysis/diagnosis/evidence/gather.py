"""First stage of a diagnosis: the runs of one robot, prepared and divided by their use."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from analysis.diagnosis.evidence.observation import ObservedRun
from analysis.diagnosis.evidence.prepared_runs import prepare_runs
from analysis.diagnosis.evidence.setups import without_a_fold
from analysis.runs.loading import Measured
from rigs.errors import FileError
from rigs.rig import Rig


@dataclass(frozen=True)
class Uses:
    """Runs by their use: for the fit, held out for validation, and measured at an unseen place."""

    used: Sequence[Measured]
    held_out: Sequence[Measured] = ()
    unseen: Sequence[Measured] = ()

    @property
    def names(self) -> tuple[list[str], list[str], list[str]]:
        """Names of the runs of each use. Without held-out runs, a part of the runs used is held out."""
        used, held_out, unseen = (
            [run.run.manifest.name for run in runs] for runs in (self.used, self.held_out or self.used, self.unseen)
        )
        return used, held_out, unseen


@dataclass(frozen=True)
class Evidence:
    """Prepared runs of a robot.

    runs, judges, elsewhere: runs used in the fit, held out, and at an unseen place; readings (m, k) mm.
    tolerance_um: largest accepted rms error of the readings; None if the limits of the rig file decide.
    doubts: doubts about the placements. withheld: table rows, from 1, of each run that rig itself holds out.
    """

    rig: Rig
    uses: Uses
    runs: Sequence[ObservedRun]
    judges: Sequence[ObservedRun]
    elsewhere: Sequence[ObservedRun]
    tolerance_um: float | None
    doubts: tuple[str, ...]
    withheld: Mapping[str, tuple[int, ...]]


def gather(rig: Rig, uses: Uses, tolerance_um: float | None, progress: Callable[[str], None]) -> Evidence:
    """Prepare the runs of a robot with the model of its rig.

    Without held-out runs, a fifth of 60 or more poses is held out, in groups of neighbouring postures. Raises FileError
    for runs of a different robot, or not readable as the stated test.
    """
    progress("reading the runs")
    (runs, judges, elsewhere), doubts = prepare_runs(rig, uses.used, uses.held_out, uses.unseen)
    withheld: dict[str, tuple[int, ...]] = {}
    if not judges:
        runs, judges = without_a_fold(runs)
        withheld = _rows_by_run(judges, uses.used)
    _require_enough_readings(runs)
    return Evidence(rig, uses, runs, judges, elsewhere, tolerance_um, tuple(doubts), withheld)


def _rows_by_run(parts: Sequence[ObservedRun], runs: Sequence[Measured]) -> dict[str, tuple[int, ...]]:
    """Return the table rows, from 1, of parts of runs, by the name of the run."""
    rows: dict[str, list[int]] = {}
    for run in runs:
        for part in (part for part in parts if part.table is run.table):
            rows.setdefault(run.run.manifest.name, []).extend((part.rows + 1).tolist())
    return {name: tuple(sorted(numbers)) for name, numbers in rows.items()}


def _require_enough_readings(runs: Sequence[ObservedRun]) -> None:
    """Raise FileError if there are fewer readings than set-up terms."""
    terms = sum({run.setup: run.facts.setup_terms for run in runs}.values())
    if (count := sum(run.values.size for run in runs)) < terms:
        raise FileError(
            "RUN…",
            f"{count} readings are fewer than the {terms} terms of the set-up",
            "give more runs",
            code="run.few_readings",
        )
