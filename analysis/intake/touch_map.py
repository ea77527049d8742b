"""Column maps for tables of touches written by hand, with joints under common names and possibly a single socket for
all rows.

Operators with a single punch mark omit the socket column, and type `J1 … J6` from the pendant.
"""

from __future__ import annotations

from pathlib import Path

from analysis.intake.column_groups import groups_of
from analysis.intake.raw_table import RawTable, layout_of, read_raw, text_of
from analysis.intake.read import header_names, read_head, read_whole
from analysis.intake.table_map import Angles, MappedColumn, TableMap
from analysis.intake.table_reading import likely_angles
from analysis.runs.table_format import format_of
from analysis.runs.table_layout import SOCKET, joint_columns, second_joint_columns
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.vocabulary import FEWEST_AXES, TestName
from rigs.text import as_argument


def needs_touch_map(path: Path, test: TestName, socket: str) -> bool:
    """True if a table of touches has columns different from docs/tables.md, or the socket is given."""
    if SOCKET not in format_of(test).layout().required:
        return False
    return bool(socket) or not {SOCKET, *joint_columns(FEWEST_AXES)} <= header_names(read_head(path))


def has_two_arms(path: Path) -> bool:
    return second_joint_columns(1)[0] in header_names(read_head(path))


def refuse_two_arms(path: Path, test: TestName) -> None:
    """Raise FileError for touches of two arms: they are no touches of a fixed socket."""
    if SOCKET in format_of(test).layout().required and has_two_arms(path):
        problem = "has p1_deg, the joints of a second arm that holds the socket"
        raise FileError(
            str(path), problem, f"calibrate both arms: rig pair FIRST SECOND {as_argument(path)}", code="touch.two_arms"
        )


def propose_touch_map(path: Path, rig: Rig, test: TestName, socket: str) -> TableMap:
    """Map of a table of touches.

    socket: of all rows; empty if a column contains it or the rig file has only one. Raises FileError if the joints of
    the arm or the socket are missing.
    """
    where = str(path)
    lines, text_layout = text_of(read_whole(path), where)
    layout = layout_of(lines, text_layout.encoding, where)
    raw = read_raw(lines, layout, where)
    optional = [name for name in format_of(test).layout(len(rig.robot.axes)).optional if name in raw.names]
    joints = _joints(raw, rig, set(optional))
    column = next((name for name in raw.names if name.strip().lower() == SOCKET), None)
    columns = {name: MappedColumn(column=name) for name in optional}
    if column and not socket:
        return TableMap(files=(layout,), joints=joints, columns={SOCKET: MappedColumn(column=column), **columns})
    return TableMap(files=(layout,), joints=joints, columns=columns, constants={SOCKET: socket or _only(rig, where)})


def _joints(raw: RawTable, rig: Rig, optional: set[str]) -> Angles:
    groups = [
        group
        for group in groups_of(raw, [axis.name for axis in rig.robot.axes]).joints
        if not optional & set(group.columns)
    ]
    group = next((group for group in groups if group.role == "measured"), groups[0] if groups else None)
    if group is None:
        axes = len(rig.robot.axes)
        problem = f"lacks columns for the {axes} joints of the arm; it has {', '.join(raw.names[:20])}"
        raise FileError(
            raw.where, problem, f"name the columns q1_deg … q{axes}_deg, or J1 … J{axes}", code="touch.no_joints"
        )
    return likely_angles(raw, group)


def _only(rig: Rig, where: str) -> str:
    sockets = rig.tests.touch.sockets if rig.tests.touch else ()
    if len(sockets) == 1:
        return sockets[0]
    declared = f", of {', '.join(sockets)}" if sockets else ""
    problem = "does not name the socket of each row"
    raise FileError(
        where, problem, f"add a column socket, or give --socket NAME for all rows{declared}", code="touch.no_sockets"
    )
