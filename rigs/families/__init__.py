"""Typical differences of link constants from the data sheet, by family of arms and by design."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import yaml

from rigs.schema.part import Part
from rigs.schema.vocabulary import MOST_AXES, Build, MakerName


class TypicalConstant(Part):
    """Typical difference, in mm or degrees, of link constants that poses cannot separate, or of a single one."""

    seats: tuple[str, ...]
    rms: float
    largest: float
    arms: int


class Family(Part):
    name: str
    maker: MakerName
    source: str
    constants: tuple[TypicalConstant, ...]


class DesignSizes(Part):
    length_mm: float
    angle_deg: float
    arms: int
    source: str


class Families(Part):
    families: tuple[Family, ...]
    designs: dict[Build, DesignSizes]


@cache
def families() -> Families:
    text = Path(__file__).with_name("sizes.yaml").read_text(encoding="utf-8")
    return Families.model_validate(yaml.safe_load(text))


@cache
def link_sizes(design: Build, maker: MakerName | None) -> dict[str, float]:
    """Typical differences from the data sheet in mm or degrees by seat (`4.alpha`), of the maker or of the design."""
    of_design = families().designs[design]
    sizes = {
        f"{axis}.{key}": of_design.length_mm if key in ("a", "d") else of_design.angle_deg
        for axis in range(1, MOST_AXES + 1)
        for key in ("a", "alpha", "d", "beta")
    }
    rows = [row for family in families().families if family.maker == maker for row in family.constants]
    return sizes | {seat: row.rms for row in rows for seat in row.seats}
