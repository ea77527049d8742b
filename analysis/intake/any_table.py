"""Unattended import of tables: the test is inferred from the columns, and the column map must be unambiguous."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from analysis.intake.column_groups import groups_of
from analysis.intake.imports import is_plain, propose_map, read_mapped, read_table
from analysis.intake.raw_table import layout_of, read_raw, text_of
from analysis.intake.read import header_names, read_head, read_whole
from analysis.intake.readers import reader_of
from analysis.intake.table_map import MAPPED
from analysis.intake.touch_map import needs_touch_map, propose_touch_map
from analysis.runs.loading import Measured
from analysis.runs.table_format import TESTS, format_of
from analysis.runs.table_layout import SOCKET
from rigs.errors import FileError
from rigs.load import load
from rigs.rig import Rig
from rigs.schema.vocabulary import TestName

_GIVE_TEST = "choose the test: rig import --test, or test= in Python"
_FEW_MISSING = 2
"""Largest number of missing columns that are named. Chosen: with more, the table is of a different kind."""


def read_any_table(source: Path, *, rig_file: str | Path, test: TestName | None, **label: Any) -> Measured:
    """Return the run of any table, not written to disk.

    test: inferred from the columns if None. label: direction, operator, placement and joints, see `read_table`.

    Raises FileError, also if only an operator could interpret the columns.
    """
    rig = load(rig_file)[0]
    kind = test_of(source, rig) if test is None else test
    if needs_touch_map(source, kind, ""):
        table_map = propose_touch_map(source, rig, kind, "")
        return read_mapped([source], table_map, rig_file=rig_file, test=kind, **label)
    if kind != MAPPED or is_plain(source, kind):
        return read_table(source, rig_file=rig_file, test=kind, **label)
    proposal = propose_map([source], rig_file)
    if proposal.questions:
        asks = "; ".join(f"{question.key}: {question.asks}" for question in proposal.questions)
        raise FileError(
            str(source), f"has open questions ({asks})", "answer the questions of rig import", code="table.questions"
        )
    return read_mapped([source], proposal.assumed().table_map, rig_file=rig_file, test=kind, **label)


def test_of(source: Path, rig: Rig) -> TestName:
    """Return the test of a table, inferred from the columns. Raises FileError if several tests match, or none."""
    where, axes, head = str(source), len(rig.robot.axes), read_head(source)
    if reader_of(head):
        raise FileError(where, "is a bag, which may contain poses or a circle", _GIVE_TEST, code="bag.ambiguous")
    names = header_names(head)
    layouts = {test: set(format_of(test).layout(axes).required) - {"direction"} for test in TESTS}
    ours = [test for test, required in layouts.items() if required <= names]
    ours = [test for test in ours if not any(layouts[test] < layouts[other] for other in ours)]
    if len(ours) == 1:
        return ours[0]
    if ours:
        raise FileError(
            where, f"may belong to {' or '.join(ours)}, which have the same columns", _GIVE_TEST, code="table.ambiguous"
        )
    if any(name.lower() == SOCKET for name in names):
        return next(test for test in TESTS if SOCKET in format_of(test).layout().required)
    lines, text_layout = text_of(read_whole(source), where)
    raw = read_raw(lines, layout_of(lines, text_layout.encoding, where), where)
    groups = groups_of(raw, [axis.name for axis in rig.robot.axes])
    if groups.joints and groups.seen:
        return MAPPED
    nearest = min(layouts, key=lambda test: len(layouts[test] - names))
    missing = sorted(layouts[nearest] - names)
    if len(missing) <= _FEW_MISSING:
        problem = f"lacks {' and '.join(missing)} of a {nearest} table"
        raise FileError(
            where, problem, "add the column, or run rig import --help for other tables", code="table.column_missing"
        )
    raise FileError(
        where,
        f"has columns that match none of the tests: {', '.join(raw.names[:20])}",
        _GIVE_TEST,
        code="table.no_test_fits",
    )
