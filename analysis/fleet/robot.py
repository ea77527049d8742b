"""One robot's runs by the catalogue of what lies below a directory, as `rig history` collects them from a directory.

A directory elsewhere takes no file of the history beside its runs, and reading each manifest again would cost a request
each: the catalogue knows what has not changed by listing alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from analysis.fleet import catalogue
from analysis.fleet.known import Progress, known_of, remade, seen_below
from analysis.fleet.seen import Seen
from analysis.history.collect import Collected, Workers, collected_of, is_of, no_run_of
from analysis.history.records import Record


def collect_by_catalogue(directory: Path, robot: str, file: Path, workers: Workers, progress: Progress) -> Collected:
    """The records of every run of a robot below a directory; file: the catalogue, which is made where it is missing.

    Raises as `analysis.fleet.gather.gather` does, and FileError where there is no run of the robot.
    """
    seen = seen_below(directory)
    return remade(file, partial(_collected, directory, robot, file, seen, workers, progress))


def _collected(
    directory: Path, robot: str, file: Path, seen: Sequence[Seen], workers: Workers, progress: Progress, why: str
) -> Collected:
    catalogued = known_of(file, seen, workers, progress, why)
    keys = sorted({entry.key for entry in catalogued.runs.values()})
    records: list[Record] = []
    rig_texts: dict[str, str] = {}
    is_known = False
    for folder, rig_name in keys:
        of_robot, texts = catalogue.records_of(file, (folder, rig_name))
        for record in of_robot:
            is_mine = bool(rig_name) and is_of(rig_name, texts[record.name], robot)
            if is_mine or not rig_name:  # of no known robot: its manifest cannot be read
                name = str(Path(folder, record.name))
                records.append(replace(record, name=name))
                rig_texts[name] = texts[record.name]
                is_known |= is_mine
    if not is_known:
        raise no_run_of(robot, directory, {name for _, name in keys if name})
    return collected_of(robot, records, catalogued.notes, rig_texts.__getitem__)
