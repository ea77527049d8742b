"""The extended rig file: the old text, and the effects that were found with where they came from."""

from __future__ import annotations

import datetime as dt
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from analysis.files.write import holding, write_new
from rigs.effects import Effect, Found
from rigs.extend import extended


def with_origin(effect: Effect, runs: Sequence[str], sd: Mapping[str, float], gap_um: tuple[float, float]) -> Effect:
    """An effect that says when and from which runs it was found, how sure, and which gap (before, after) it closed.

    Numbers are cut to nine digits, uncertainties to three, gaps to the nanometre: a person reads this file.
    """
    before, after = gap_um
    origin = Found(
        date=dt.datetime.now(dt.UTC).date(),
        runs=tuple(runs),
        sd={field: float(f"{value:.3g}") for field, value in sd.items() if math.isfinite(value)},
        gap_um=(round(before, 3), round(after, 3)),
    )
    numbers = {field: value for field, value in effect if isinstance(value, float)}
    rounded = {field: float(f"{value:.9g}") for field, value in numbers.items()}
    return effect.model_copy(update={"found": origin, **rounded})


def beside(effect: Effect, **more: object) -> Effect:
    """An effect whose origin says more: `rivals`, `together`, `correlation` or `joints_deg` of `Found`."""
    origin = effect.found
    return effect if origin is None else effect.model_copy(update={"found": origin.model_copy(update=more)})


def write_extended(text: str, effects: Sequence[Effect], output: Path) -> None:
    """A rig file's text with effects added, as a new file. Raises FileError where it exists or cannot be written,
    RigFileError where an effect is beyond its bounds."""
    write_new(output, holding(extended(text, effects, str(output)).encode()))
