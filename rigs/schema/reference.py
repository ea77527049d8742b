"""Arms that an arm is compared with, to decide which deviations are usual and which may be faults."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from rigs.schema.vocabulary import Build


@dataclass(frozen=True)
class Reference:
    """Comparable arms: of the same design and, for link constants, of the same family.

    link_sizes: typical deviation of each link constant in mm or degrees, by seat (`4.alpha`). is_data_sheet: True if
    the model has the constants of the data sheet.
    """

    design: Build
    link_sizes: Mapping[str, float] = field(default_factory=dict)
    is_data_sheet: bool = False
