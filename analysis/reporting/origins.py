"""Where the effects of a rig file and the runs of a robot came from, in words."""

from __future__ import annotations

from collections.abc import Sequence

from rigs.effects import Effect
from rigs.schema.effect import name_of

_MOST_NAMED = 5


def begins_with(effects: Sequence[Effect]) -> str:
    """How many effects a model begins with, which, and from where: `2 effects, written by hand: …`."""
    origins: dict[str, list[str]] = {}
    for effect in effects:
        origins.setdefault(_origin(effect), []).append(name_of(effect))
    count = f"{len(effects)} effect{'s' * (len(effects) != 1)}"
    return f"{count}, " + "; ".join(f"{origin}: {_listed(names)}" for origin, names in origins.items())


def simulated_runs(simulated: int, runs: int) -> str:
    """Say that runs measured no robot; empty where all did. simulated: how many of the runs."""
    if not simulated:
        return ""
    if simulated == runs:
        which, whose = "This run is" if runs == 1 else "All runs are", "no robot was measured"
    else:
        which, whose = f"{simulated} of {runs} runs {'is' if simulated == 1 else 'are'}", "that measured no robot"
    return f"{which} simulated or of an emulated cell; {whose}."


def _origin(effect: Effect) -> str:
    if effect.found is None:
        return "written by hand"
    return f"found on {effect.found.date} in {_listed(effect.found.runs)}"


def _listed(names: Sequence[str]) -> str:
    more = len(names) - _MOST_NAMED
    return ", ".join(names[:_MOST_NAMED]) + (f" and {more} more" if more > 0 else "")
