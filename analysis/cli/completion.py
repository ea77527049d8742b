"""What a shell offers for the word being typed: runs, rig files, arms, robots, running daemons.

Nothing is read that is not needed, since a person waits. typer leaves out what does not begin as the word does; where
nothing is offered, the shell completes file names.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterator
from functools import wraps
from pathlib import Path

import typer

SERVED = Path("/etc/rig")
"""Where the rig files of services are."""
_LEVELS = 2
"""Runs are looked for so many levels below the directory typed, as runs/NAME is below none, not in a whole disk."""


def _quietly(offer: Callable[..., Iterator[str]]) -> Callable[..., list[str]]:
    """What is offered, as far as it can be read; a name that a terminal cannot show is left out."""

    @wraps(offer)
    def offered(*arguments: object, **named: object) -> list[str]:
        names: list[str] = []
        # Without these, an error would be written into the line that is being typed.
        with contextlib.suppress(OSError, ImportError, ValueError):
            names.extend(name for name in offer(*arguments, **named) if name.isprintable())
        return names

    return offered


@_quietly
def runs(incomplete: str) -> Iterator[str]:
    """Offer the run directories that begin so."""
    folder, slash, begun = incomplete.rpartition("/")
    yield from _runs_below(folder + slash, begun, _LEVELS)


def _runs_below(folder: str, begun: str, levels: int) -> Iterator[str]:
    """Run directories whose path below the folder begins so. folder: with its slash, or empty for this directory."""
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
    """Offer the rig files of the directory typed, and the names of the shipped ones."""
    from rigs.load import shipped

    folder = "".join(incomplete.rpartition("/")[:2])
    yield from (folder + file.name for file in sorted(Path(folder).glob("*.yaml")))
    yield from shipped()


@_quietly
def arms() -> Iterator[str]:
    """Offer the arms of the library."""
    from rigs.arms import arm_names

    yield from arm_names()


@_quietly
def robots(ctx: typer.Context) -> Iterator[str]:
    """Offer the rigs that the runs below --runs were made with."""
    directory = Path(ctx.params.get("runs") or "runs")
    names = (json.loads((run / "manifest.json").read_bytes()) for run in directory.iterdir() if _is_run(run))
    yield from sorted({str(manifest["rig_name"]) for manifest in names})


@_quietly
def daemons() -> Iterator[str]:
    """Offer the rigs whose daemons run."""
    from daq.service.client import sockets

    yield from (path.stem for path in sockets())


@_quietly
def services() -> Iterator[str]:
    """Offer the rigs that a service is set up for."""
    yield from sorted(file.stem for file in SERVED.glob("*.yaml"))
