"""Tables on a screen that is too narrow for them."""

from __future__ import annotations

from rich.table import Table


def whole(table: Table) -> Table:
    """The same, long words of its cells broken where rich would cut them off and leave an ellipsis."""
    for column in table.columns:
        column.overflow = "fold"
    return table
