"""Export of results to scripts and notebooks: dictionaries for JSON, Arrow tables, and pandas frames.

Tables are pyarrow Tables, because the store requires pyarrow, and because pandas, polars and DuckDB read them without
copying. pandas is optional, and used only by `to_frame`.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import is_dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rigs.errors import RigError

if TYPE_CHECKING:
    import pyarrow as pa


class Tabular(ABC):
    """A result in table form: angles in degrees, lengths in mm, and units in the column names."""

    @abstractmethod
    def to_table(self) -> pa.Table:
        """A pyarrow Table."""

    def to_frame(self) -> Any:
        """A pandas DataFrame. Raises RigError if pandas is not installed."""
        try:
            import_module("pandas")
        except ModuleNotFoundError as error:
            if error.name != "pandas":
                raise
            raise RigError(
                "to_frame()", "pandas is not installed", "install pandas, or use to_table()", code="package.missing"
            ) from None
        return self.to_table().to_pandas()


def table_of_rows(columns: Sequence[str], rows: Sequence[Mapping[str, Any]]) -> pa.Table:
    """Build a table from rows by column name. The columns exist even if there are no rows."""
    import pyarrow as pa  # noqa: PLC0415 - a fifth of a second, which reading a rig file need not wait for

    return pa.table({name: [row[name] for row in rows] for name in columns})


def for_json(value: Any) -> Any:
    """Convert a value to plain types, data classes by field. NaN and infinity become null, because JSON lacks them."""
    match value:
        case bool() | int() | str() | None:
            return value
        case float():
            return float(value) if math.isfinite(value) else None
        case Mapping():
            return {str(key): for_json(item) for key, item in value.items()}
        case list() | tuple():
            return [for_json(item) for item in value]
        case Path():
            return str(value)
    return for_json(vars(value) if is_dataclass(value) else value.tolist())


def pick_fields(value: object, *names: str) -> dict[str, Any]:
    """Attributes by name, for an object of JSON."""
    return {name: getattr(value, name) for name in names}
