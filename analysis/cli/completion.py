"""Shell completion of arguments: runs, rig files, arms, robots, running daemons.

typer drops candidates with a different prefix; if none remains, the shell completes file names.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterator
from functools import wraps
from pathlib import Path

import typer

SERVED = Path("/etc/rig")
"""Directory of the rig files of services."""
_LEVELS = 2
"""Number of directory levels searched for runs, not a whole disk."""


def _quietly(offer: Callable[..., Iterator[str]]) -> Callable[..., list[str]]:
    """Readable candidates, except names that a terminal cannot show."""

    @wraps(offer)
    def offered(*arguments: object, **named: object) -> list[str]:
        names: list[str] = []
        # An exception would print an error into the line being typed.
        with contextlib.suppress(OSError, ImportError, ValueError):
            names.extend(name for name in offer(*arguments, **named) if name.isprintable())
        return names

    return offered


@_quietly
def runs(incomplete: str) -> Iterator[str]:
    folder, slash, begun = incomplete.rpartition("/")
    yield from _runs_below(folder + slash, begun, _LEVELS)


def _runs_below(folder: str, begun: str, levels: int) -> Iterator[str]:
    """Run directories below a folder, whose name ends with a slash or is empty, with a given prefix."""
    for entry in sorted(Path(folder).iterdir()):
        if not entry.name.startswith(begun) or entry.name.startswith(".") or not entry.is_dir():
            continue
        if _is_run(entry):
            yield folder + entry.name
        elif levels > 1:
            with contextlib.suppress(PermissionError):
                yield from _runs_below(f"{folder}{entry.name}/", "", levels - 1)


def _is_run(path: Path) -> bool:
    return (path / "manifest.json").is_file()


@_quietly
def rig_files(incomplete: str) -> Iterator[str]:
    from rigs.load import shipped

    folder = "".join(incomplete.rpartition("/")[:2])
    yield from (folder + file.name for file in sorted(Path(folder).glob("*.yaml")))
    yield from shipped()


@_quietly
def rigs_and_arms(incomplete: str) -> Iterator[str]:
    yield from rig_files(incomplete)
    yield from arms()


@_quietly
def arms() -> Iterator[str]:
    from rigs.arms import arm_names

    yield from arm_names()


@_quietly
def robots(ctx: typer.Context) -> Iterator[str]:
    directory = Path(ctx.params.get("runs") or "runs")
    names = (json.loads((run / "manifest.json").read_bytes()) for run in directory.iterdir() if _is_run(run))
    yield from sorted({str(manifest["rig_name"]) for manifest in names})


@_quietly
def daemons() -> Iterator[str]:
    from daq.service.client import sockets

    yield from (path.stem for path in sockets())


@_quietly
def services() -> Iterator[str]:
    yield from sorted(file.stem for file in SERVED.glob("*.yaml"))
