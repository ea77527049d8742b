"""Shipped cells whose arm has the same name as their `name`."""

CELLS = {"ur10": "ur10-cell", "ur10e": "ur10e-cell"}


def cell_name(name: str) -> str:
    """Name of the shipped cell of an arm, such as ur10e-cell of ur10e; other names stay."""
    return CELLS.get(name, name)
