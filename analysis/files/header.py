"""The header line of a table: which columns there are, which are missing, and what they may be called instead."""

from __future__ import annotations

import difflib
import re
from collections import Counter

from analysis.files.cells import TableFileError, TableProblem, quoted
from analysis.traces.table_layout import LAYOUTS, RAIL, TURN, WORDS, Layout, came_from_columns, layout_of
from rigs.errors import FileError
from rigs.schema.vocabulary import WITHOUT_GAUGES, TestName
from rigs.text import as_argument

_OF_ANY = {name for layout in LAYOUTS.values() for name in layout.known}
"""A column that means something in another test is that, and no other one misspelt."""
_CELL = r"[\s0-9.eE+-]*|" + "|".join(word for words in WORDS.values() for word in words)
"""A number, or a word of a column of words: the first line of a table without a header."""
_UNITS = {"deg": "degrees", "mm": "mm", "s": "seconds"}


def check_header(
    where: str, names: list[str], test: TestName, direction_given: bool, axes: int = 6, layout: Layout | None = None
) -> None:
    """Whether these columns make a table of a test; layout: of an arm of so many axes without a rail, if none is given.

    direction_given: a direction column may be missing. Raises FileError for another separator,
    TableFileError for wrong or missing columns.
    """
    _separator(where, names)
    layout = layout or layout_of(test, axes)
    problems = [
        TableProblem(1, name, "this column occurs twice; remove or rename one")
        for name, count in Counter(names).items()
        if count > 1
    ]
    missing = [name for name in layout.required if name not in names and not (direction_given and name == "direction")]
    if len(missing) == len(layout.required) and all(re.fullmatch(_CELL, name) for name in names):
        raise FileError(where, "has no header line", f"make this its first line: {','.join(layout.required)}")
    problems += [TableProblem(1, name, _missing(name, names, layout, test)) for name in missing]
    if test in WITHOUT_GAUGES and RAIL in names and RAIL not in layout.known:
        what = "the arm of the rig file stands on no rail; add robot.rail to it, or rename this column"
        problems.append(TableProblem(1, RAIL, what))
    turns = [name for name in TURN if name in names]
    if test == "pose" and 0 < len(turns) < len(TURN):
        problems.append(TableProblem(1, "", f"has {' and '.join(turns)} only; give all of {', '.join(TURN)}, or none"))
    came = [name for name in came_from_columns(axes) if name in names]
    if test == "touch" and 0 < len(came) < axes:
        every = ", ".join(came_from_columns(axes))
        problems.append(TableProblem(1, "", f"has {' and '.join(came)} only; give all of {every}, or none"))
    if problems:
        mapped = "" if test == "pose" else "; a map reads other names and units (--map)"
        raise TableFileError(where, problems, f"a {test} table needs {','.join(layout.required)}{mapped}")


def _separator(where: str, names: list[str]) -> None:
    if len(names) > 2:
        return
    line = ",".join(names)
    if line.count(";") > 2:
        remedy = f"save it with commas and decimal points: sed 'y/,;/.,/' {as_argument(where)} > TABLE.csv"
        raise FileError(where, "separates its columns by semicolons", remedy)
    if line.count("\t") > 2:
        remedy = f"save it with commas between columns: tr '\\t' ',' < {as_argument(where)} > TABLE.csv"
        raise FileError(where, "separates its columns by tabs", remedy)


def _missing(name: str, names: list[str], layout: Layout, test: TestName) -> str:
    # The extra column that may be the missing one: of the same stem (g1_inch for g1_mm), or written alike.
    others = [extra for extra in names if extra not in _OF_ANY]
    of_same_stem = [extra for extra in others if _stem(extra) == _stem(name)]
    taken = {_stem(column) for column in layout.known}
    alike = difflib.get_close_matches(name, [extra for extra in others if _stem(extra) not in taken], n=1)
    near = next(iter(of_same_stem + alike), None)
    if near:
        stem, _, unit = name.rpartition("_")
        unit_hint = f", in {_UNITS[unit]}" if stem and unit in _UNITS and not near.endswith(unit) else ""
        return f"this column is missing; is it {quoted(near)}? Then name it {name}{unit_hint}"
    if name == "direction":
        return "this column is missing; add it, or give --direction cw or acw"
    if test in ("yaw", "roll") and name == "g2_mm":
        return "this column is missing; an angle takes two gauges"
    return "this column is missing; add it"


def _stem(name: str) -> str:
    return re.split(r"[\W_]", name.strip().lower())[0]
