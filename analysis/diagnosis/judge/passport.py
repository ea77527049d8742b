"""Distances of the real arm from the data sheet, from the arm in the controller, and from the last visit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from analysis.procedures.shared.quantity import Quantity
from rigs.effects import Effect
from rigs.schema.effect import name_of


@dataclass(frozen=True)
class Passport:
    """Rms distances of the tool in µm over the joint ranges of the runs, with base and tool taught; None if unknown.

    changed: certain effects that are not part of the factory state or of the last visit.
    """

    data_sheet: Quantity | None
    controller: Quantity | None
    last_visit: Quantity | None
    changed: tuple[Effect, ...]

    @property
    def distances(self) -> dict[str, Quantity]:
        """The known distances by the name of the other arm."""
        every = {"data_sheet": self.data_sheet, "controller": self.controller, "last_visit": self.last_visit}
        return {name: distance for name, distance in every.items() if distance is not None}

    def to_dict(self) -> dict[str, Any]:
        """Return plain types: each distance with its standard uncertainty in µm, or None."""
        none = dict.fromkeys(("data_sheet_um", "controller_um", "last_visit_um"))
        known = {f"{name}_um": {"value": of.value, "u": of.u} for name, of in self.distances.items()}
        return none | known | {"changed": [name_of(effect) for effect in self.changed]}
