"""Columns of a file as the fields of a table (`Rows`), and the joints of a table as columns (`joint_cells`)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import takewhile

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from analysis.robot.kinematics.arm import RAIL_MM, Array, Integers
from analysis.runs.table_layout import RAIL, joint_columns
from daq.store.chunk import array_of
from rigs.schema.vocabulary import DRIVEN_AXES, FEWEST_AXES, MOST_AXES


@dataclass(frozen=True)
class Rows:
    """Columns of docs/tables.md for a kind of test, without extra columns."""

    columns: pa.Table

    @cached_property
    def axes(self) -> int:
        """Number of joints in the table, at least six. Unrelated columns with a joint name, such as a gripper,
        contain text.
        """
        joints = list(takewhile(self._is_measured, joint_columns(MOST_AXES)))
        return len(joints) if len(joints) >= FEWEST_AXES else DRIVEN_AXES

    @cached_property
    def rail(self) -> bool:
        """True if the table contains rail positions. An unrelated column of that name contains text."""
        return self._is_measured(RAIL)

    @property
    def q(self) -> Array:
        """Angles (n, axes) rad."""
        return np.radians(self.stack(joint_columns(self.axes)))

    def has(self, names: tuple[str, ...]) -> bool:
        """True if the table has all of these columns."""
        return set(names) <= set(self.columns.column_names)

    def floats(self, name: str) -> Array:
        """A column (n,) of numbers."""
        return np.asarray(array_of(self.columns[name]), dtype=float)

    def stack(self, names: tuple[str, ...]) -> Array:
        """Columns of numbers side by side, (n, k)."""
        return np.stack([self.floats(name) for name in names], axis=1)

    def counts(self, name: str) -> Integers:
        """A column (n,) of counts."""
        return array_of(self.columns[name])

    def words(self, name: str) -> NDArray[np.str_]:
        """A column (n,) of words without a unit."""
        return np.array(self.columns[name].to_pylist(), dtype=np.str_)

    def times(self) -> Array:
        """Times (n,) s, zeros if the table has none."""
        return self.floats("t_s") if self.has(("t_s",)) else np.zeros(self.columns.num_rows)

    def with_rail(self, q: Array, name: str = RAIL) -> Array:
        """Angles q (n, axes) rad with the rail position in m, if the table contains it."""
        return np.column_stack([q, self.floats(name) / RAIL_MM]) if self.rail else q

    def _is_measured(self, name: str) -> bool:
        schema = self.columns.schema
        return name in schema.names and pa.types.is_floating(schema.field(name).type)


def joint_cells(
    q: Array, *, rail: bool, names: Callable[[int], tuple[str, ...]] = joint_columns, rail_name: str = RAIL
) -> dict[str, Array]:
    """Columns of angles q (n, axes) rad by name, in degrees, followed by a rail in mm."""
    axes = q.shape[1] - rail
    cells = dict(zip(names(axes), np.degrees(q[:, :axes]).T, strict=True))
    return cells | ({rail_name: RAIL_MM * q[:, axes]} if rail else {})
