"""The extended rig file: the old text, and the effects that were found with where they came from."""

from __future__ import annotations

import datetime as dt
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from analysis.files.write import make_parent
from rigs.effects import Effect, Found
from rigs.errors import FileError
from rigs.extend import extended


def with_origin(
    effect: Effect,
    sd: Mapping[str, float],
    runs: Sequence[str],
    gap_um: tuple[float, float],
    joints_deg: Sequence[tuple[float, float]] | None = None,
    correlation: Mapping[str, float] | None = None,
    together: Sequence[str] = (),
) -> Effect:
    """An effect that says when and from which runs it was found, how sure, and which gap (before, after) it closed,
    where the joints were meanwhile, how its size goes with those of other effects, and which
    of those look like it.

    Numbers are cut to nine digits, uncertainties to three, gaps to the nanometre, ranges to a hundredth of a degree: a
    person reads this file. Correlations keep five digits: of twins only the sum is known, by what they differ from -1.
    """
    before, after = gap_um
    origin = Found(
        date=dt.datetime.now(dt.UTC).date(),
        runs=tuple(runs),
        sd={field: float(f"{value:.3g}") for field, value in sd.items() if math.isfinite(value)},
        gap_um=(round(before, 3), round(after, 3)),
        correlation={name: round(value, 5) for name, value in (correlation or {}).items()},
        together=tuple(together),
        joints_deg=joints_deg and tuple((round(low, 2), round(high, 2)) for low, high in joints_deg),
    )
    numbers = {field: value for field, value in effect if isinstance(value, float)}
    rounded = {field: float(f"{value:.9g}") for field, value in numbers.items()}
    return effect.model_copy(update={"found": origin, **rounded})


def write_extended(text: str, effects: Sequence[Effect], output: Path) -> None:
    """A rig file's text with effects added, as a new file. Raises FileError where it exists or cannot be written,
    RigFileError where an effect is beyond its bounds."""
    grown = extended(text, effects, str(output))
    make_parent(output)
    try:
        with output.open("x", encoding="utf-8") as file:
            file.write(grown)
    except FileExistsError:
        raise FileError(str(output), "exists already", "give another --output, or remove it first") from None
    except OSError as error:
        raise FileError(str(output), error.strerror or str(error), "give another --output") from None
