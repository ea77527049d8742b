"""A movement between runs, or between rows of a run, as reported by a diagnosis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from rigs.schema.part import Vector

Alike = Literal["instrument", "plate", "base", "tool"]


@dataclass(frozen=True)
class Movement:
    """A movement before the first reading of `to`, which names a run, or a run and row.

    `translation_mm` and `rotation_deg` refer to the axes of the base, for a tool to the axes of the flange. A zero of
    `axis` has only `size_deg`. `u_mm` is the standard uncertainty of the length of the shift, `u_deg` of a zero,
    `u_rotation_deg` of the rotation. `row`: row of the file of `run` from which it moved, None between runs.
    `alike`: part with the same readings, None if the cause is distinguished from every part.
    """

    from_: str
    to: str
    what: Literal["base", "instrument", "socket", "target", "tool", "zero"]
    odds: float
    axis: int | None = None
    name: str = ""
    translation_mm: Vector | None = None
    rotation_deg: Vector | None = None
    size_deg: float | None = None
    u_mm: float | None = None
    u_deg: float | None = None
    u_rotation_deg: float | None = None
    run: str = ""
    row: int | None = None
    alike: Alike | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return plain types for JSON."""
        return {
            "from": self.from_, "to": self.to, "what": self.what, "alike": self.alike, "axis": self.axis,
            "name": self.name or None,
            "translation_mm": self.translation_mm, "rotation_deg": self.rotation_deg, "size_deg": self.size_deg,
            "u_mm": self.u_mm, "u_deg": self.u_deg, "odds": self.odds,
        }  # fmt: skip
