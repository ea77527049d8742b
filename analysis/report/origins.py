"""Descriptions of the provenance of effects in a rig file and of runs."""

from __future__ import annotations

from collections.abc import Sequence

from rigs.calibration import CalibratedModel
from rigs.effect_names import name_in_words
from rigs.effects import Effect
from rigs.schema.effect import name_of
from rigs.text import counted, first_of

_MOST_NAMED = 5


def begins_with(effects: Sequence[Effect]) -> str:
    """Return a sentence on the effects that a model contains initially: `2 effects, written by hand: …`."""
    origins: dict[str, list[str]] = {}
    for effect in effects:
        origin = (
            "written by hand"
            if effect.found is None
            else f"found on {effect.found.date} in {first_of(effect.found.runs, _MOST_NAMED)}"
        )
        origins.setdefault(origin, []).append(name_in_words(name_of(effect)))
    listed = "; ".join(f"{origin}: {first_of(names, _MOST_NAMED)}" for origin, names in origins.items())
    return f"{counted(len(effects), 'effect')}, {listed}"


def in_calibration(model: CalibratedModel) -> list[str]:
    """Return the terms of a calibrated model, the accuracy on the runs, and the covered joint ranges."""
    runs = first_of([run.name for run in model.runs], _MOST_NAMED)
    accuracy = f"error in its runs {model.before_um:.0f} µm rms, with the calibration {model.calibrated_um:.0f} µm"
    if model.held_out_um is not None:
        accuracy += f" ({model.held_out_um:.0f} µm in readings not used to fit it)"
    if model.widened > 1:
        accuracy += f"; the uncertainty was increased {model.widened:.2g} times, because these readings required it"
    joints = ", ".join(f"{axis}: {low:z.0f}° to {high:z.0f}°" for axis, (low, high) in enumerate(model.joints_deg, 1))
    return [
        f"calibrated on {model.date} from {runs}: {len(model.terms)} terms; {accuracy}",
        f"valid for these joint angles, axis by axis: {joints}; outside, typical errors are assumed",
    ]


def simulated_runs(simulated: int, runs: int) -> str:
    """Return a sentence if some of the runs are simulated; empty if all measured a robot. simulated: number of such
    runs.
    """
    if not simulated:
        return ""
    if simulated == runs:
        which, whose = "This run was" if runs == 1 else "All runs were", "No real robot was measured."
    else:
        which = f"{simulated} of {runs} runs {'was' if simulated == 1 else 'were'}"
        whose = f"{'It does' if simulated == 1 else 'They do'} not show a real robot."
    return f"{which} simulated or recorded in an emulated cell. {whose}"
