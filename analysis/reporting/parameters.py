"""An effect's parameters as people read them: with unit and uncertainty."""

from __future__ import annotations

from collections.abc import Mapping

from analysis.reporting.quantity import Quantity
from rigs.effects import Effect

PLACES = ("axis", "field", "gauge", "from_axis", "to_axis")
"""What says which effect it is, beside its name."""


def unit_of(effect: Effect, field: str) -> str:
    """The unit of a parameter, as Quantity writes units; empty for a ratio."""
    if field == "delta":
        return "mm" if getattr(effect, "field", "") in ("a", "d") else "deg"
    if "_per_" in field:
        return field.replace("_per_", "/")
    return field.rsplit("_", 1)[-1] if "_" in field else {"ppm": "ppm"}.get(field, "")


def quantity_of(effect: Effect, field: str, sd: Mapping[str, float]) -> Quantity:
    """A parameter of an effect; its standard uncertainty is 0 where nobody knows it."""
    return Quantity(float(getattr(effect, field)), sd.get(field, 0.0), unit_of(effect, field))


def parameters_of(effect: Effect) -> dict[str, float]:
    """Its numbers: sizes and shapes, and what it needs to be given, such as the order of a gear."""
    return {key: value for key, value in effect if key not in PLACES and isinstance(value, int | float)}
