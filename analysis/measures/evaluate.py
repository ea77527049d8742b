"""From a table to the figures of its test: one function for measured and simulated tables alike."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from analysis.noise.spectrum import LapNoise
from analysis.traces.tables import Table
from rigs.rig import Rig

if TYPE_CHECKING:
    from analysis.measures.quantity import Quantity
    from analysis.measures.reduction import Reduced
    from analysis.measures.result_curves import ResultCurve


class Evaluated(Protocol):
    """What a test found: figures by name, of so many samples, notes in words, and the curve or points behind them."""

    @property
    def figures(self) -> Mapping[str, Quantity]: ...
    @property
    def samples(self) -> int: ...
    @property
    def notes(self) -> tuple[str, ...]: ...
    @property
    def as_curve(self) -> ResultCurve: ...


@dataclass(frozen=True)
class Instruments:
    """What is known of the instruments beside a table. u_lag_s: standard uncertainty of the gauges' time against the
    joints'; u_gauge_mm: of one reading, the rig file's where None; like: noise of the angle and of the distance in
    another run, for a circle of a single lap; reduced: the readings of a circle, where its table has but some of its
    rows."""

    u_lag_s: float = 0.0
    u_gauge_mm: float | None = None
    like: tuple[LapNoise, LapNoise] | None = None
    reduced: Reduced | None = None

    def u_mm(self, rig: Rig) -> float:
        """The standard uncertainty of one reading of a gauge."""
        return rig.gauges.g1.accuracy_mm if self.u_gauge_mm is None else self.u_gauge_mm


def evaluate(
    table: Table,
    rig: Rig,
    u_lag_s: float,
    where: str,
    u_gauge_mm: float | None = None,
    like: tuple[LapNoise, LapNoise] | None = None,
    reduced: Reduced | None = None,
) -> Evaluated:
    """The figures of a table, with what is known of its instruments (`Instruments`).

    Raises FileError where it is not a valid measurement of its test.
    """
    return table.kind.evaluate(table, rig, where, Instruments(u_lag_s, u_gauge_mm, like, reduced))
