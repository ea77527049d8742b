"""The robots of a plant on a terminal and as JSON."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from analysis.fleet.gather import Fleet
from analysis.fleet.state import ORDER, Attention, State
from analysis.frames import for_json
from analysis.history.words import without_figures
from analysis.reporting.origins import simulated_runs
from analysis.reporting.plain_console import whole
from rigs.text import plain

WORDS: dict[Attention, str] = {
    "beyond": "beyond a limit",
    "watch": "watch",
    "unreadable": "no figures",
    "changed": "has changed",
    "within": "within limits",
    "unlimited": "no limits",
}
_STYLES: dict[Attention, str] = {"beyond": "bold red", "watch": "yellow", "unreadable": "yellow", "changed": "yellow"}


def as_screen(fleet: Fleet) -> RenderableType:
    """A sentence, a line for each robot, and what was left out."""
    doubts = (Text(line, style="yellow") for line in doubts_of(fleet))
    simulated = [Text(line, style="yellow") for line in filter(None, [origin(fleet)])]
    summed_up = Text(summary(fleet), style="bold")
    table = Table(header_style="bold", box=None, padding=(0, 1))
    table.add_column("robot")
    table.add_column("state")
    table.add_column("nearest to its limit")
    table.add_column("what changed")
    table.add_column("last run", no_wrap=True)
    table.add_column("runs", justify="right", no_wrap=True)
    for state, name in zip(fleet.robots, names_of(fleet), strict=True):
        standing = Text(WORDS[state.attention], style=_STYLES.get(state.attention, ""))
        share = [Text(simulated_share(state), style="yellow")] if state.simulated else []
        robot = Text("\n").join([Text(name), *share])
        # The figure nearest to its limit, the tests, and what to know before trusting it, a line each
        lines = [Text(state.worst)] if state.worst else []
        lines += [Text(", ".join(state.tests), style="dim")] if state.tests else []
        lines += [Text(plain(", ".join(state.doubts)), style="yellow")] if state.doubts else []
        table.add_row(robot, standing, Text("\n").join(lines), state.trend, state.last[:10], str(state.runs))
    return Group(*simulated, summed_up, whole(table), *doubts, Text(reading(fleet), style="dim"))


def origin(fleet: Fleet) -> str:
    """Say whether runs are simulated; empty where none is."""
    return simulated_runs(sum(state.simulated for state in fleet.robots), sum(state.runs for state in fleet.robots))


def simulated_share(state: State) -> str:
    """How many runs of a robot are simulated, as it stands beside its name; empty where none is."""
    if not state.simulated:
        return ""
    return "simulated" if state.simulated == state.runs else f"{state.simulated} of {state.runs} simulated"


def summary(fleet: Fleet) -> str:
    """How many robots there are, and how many of them stand how."""
    counts = [(sum(state.attention == reason for state in fleet.robots), WORDS[reason]) for reason in ORDER]
    words = ", ".join(f"{count} {word}" for count, word in counts if count)
    return f"{len(fleet.robots)} {'robot' if len(fleet.robots) == 1 else 'robots'}: {words or 'none is known'}."


def reading(fleet: Fleet) -> str:
    """How many runs there are, and how many of them had to be read."""
    gone = f", {fleet.gone} gone" if fleet.gone else ""
    return f"{fleet.runs} runs, {fleet.examined} of them read (new, changed, or unreadable the last time){gone}"


def doubts_of(fleet: Fleet) -> list[str]:
    """What to know of the catalogue, and runs that are left out: those of no known robot, then each robot's."""
    left_out = [*fleet.strays]
    left_out += [(str(Path(state.folder, run)), why) for state in fleet.robots for run, why in state.without_figures]
    return [*fleet.notes, *without_figures(left_out)]


def names_of(fleet: Fleet) -> list[str]:
    """The name of each robot, in their order; with its directory where another has the same name."""
    times = Counter(state.robot for state in fleet.robots)
    return [
        plain(state.robot if times[state.robot] == 1 else f"{state.robot} in {state.folder}") for state in fleet.robots
    ]


def as_object(fleet: Fleet) -> dict[str, Any]:
    """The same for scripts, with every run that was left out and why."""
    plain: dict[str, Any] = for_json(
        {
            "directory": str(fleet.directory),
            "catalogue": str(fleet.catalogue) if fleet.catalogue.exists() else None,  # kept for this time alone
            "robots": [
                asdict(state) | {"attention": state.attention, "without_figures": dict(state.without_figures)}
                for state in fleet.robots
            ],
            "without_robot": dict(fleet.strays),
            "notes": list(fleet.notes),
            "runs": fleet.runs,
            "runs_read": fleet.examined,
            "runs_gone": fleet.gone,
        }
    )
    return plain
