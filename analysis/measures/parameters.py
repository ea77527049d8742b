"""An effect's parameters as people read them: with unit and uncertainty."""

from __future__ import annotations

from collections.abc import Mapping

from analysis.measures.quantity import Quantity
from rigs.effects import Effect
from rigs.schema.effect import SEATS, label_of, size_field


def quantity_of(effect: Effect, field: str, sd: Mapping[str, float]) -> Quantity:
    """A parameter of an effect; its standard uncertainty is 0 where it is unknown."""
    return Quantity(float(getattr(effect, field)), sd.get(field, 0.0), effect.unit(field))


def parameters_of(effect: Effect) -> dict[str, float]:
    """Its numbers: sizes and shapes, and what it needs to be given, such as the order of a gear."""
    return {key: value for key, value in effect if key not in SEATS and isinstance(value, int | float)}


def parameter_label(effect: Effect, field: str) -> str:
    """The label of an effect, with the field where it is not its size."""
    return label_of(effect) if field == size_field(effect) else f"{label_of(effect)} {field}"
