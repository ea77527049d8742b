"""Runs from table files, checked against the rig.

Tables in other formats than docs/tables.md are touches written by hand, or poses with a proposed map.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from analysis.intake.column_groups import count_places, groups_of
from analysis.intake.converted import csv_of, is_convertible
from analysis.intake.map_proposal import MapProposal, propose
from analysis.intake.mapped import MappedPoses, poses_of, table_by, with_joints
from analysis.intake.raw_table import RawTable, is_workbook, joined, layout_of, read_files, read_raw, sheets_of, text_of
from analysis.intake.read import check_sequence, read_file
from analysis.intake.readers import reader_of
from analysis.intake.table_files import cut_off_doubts, header_names, read_head, read_text, read_whole
from analysis.intake.table_map import MAPPED, TO_UNIT, Angles, FileLayout, MappedColumn, TableMap, map_text
from analysis.intake.table_problems import Problems
from analysis.intake.table_reading import likely_angles
from analysis.procedures.checks.check_runs import doubts_of, refuse_impossible
from analysis.procedures.checks.columns import FEWEST
from analysis.procedures.shared.test_kind import kind_of, require_live_gauges
from analysis.robot.geometry.iso_cube import cube_of
from analysis.runs.loading import Measured, measured_of
from analysis.runs.tables import (
    CONTROLLER_PLACE,
    MEASURED,
    PLACE,
    SOCKET,
    TESTS,
    JointSource,
    format_of,
    joint_columns,
    second_joint_columns,
)
from daq.store import Run, table_run
from rigs.errors import FileError, UseError
from rigs.load import load, named_by
from rigs.readiness import require_instruments
from rigs.rig import Rig
from rigs.schema.vocabulary import FEWEST_AXES, Direction, TestName
from rigs.text import as_argument


def _is_of_touches(test: TestName) -> bool:
    return SOCKET in format_of(test).layout().required


def needs_touch_map(path: Path, test: TestName, socket: str) -> bool:
    """True if a table of touches has columns different from docs/tables.md, or the socket is given."""
    if not _is_of_touches(test):
        return False
    return bool(socket) or not {SOCKET, *joint_columns(FEWEST_AXES)} <= header_names(read_head(path))


def has_two_arms(path: Path) -> bool:
    return second_joint_columns(1)[0] in header_names(read_head(path))


def refuse_two_arms(path: Path, test: TestName) -> None:
    if _is_of_touches(test) and has_two_arms(path):
        problem = "has p1_deg, the joints of a second arm that holds the socket"
        raise FileError(
            str(path), problem, f"calibrate both arms: rig pair FIRST SECOND {as_argument(path)}", code="robot.other"
        )


def propose_touch_map(path: Path, rig: Rig, test: TestName, socket: str) -> TableMap:
    """Map of a table of touches.

    socket: of all rows; empty if a column contains it or the rig file has only one.
    """
    raw, layout = _raw_table(read_text(path), str(path))
    optional = [name for name in format_of(test).layout(len(rig.robot.axes)).optional if name in raw.names]
    joints = _joints(raw, rig, set(optional))
    columns = {name: MappedColumn(column=name) for name in optional}
    if raw.socket_column and not socket:
        columns = {SOCKET: MappedColumn(column=raw.socket_column), **columns}
        return TableMap(files=(layout,), joints=joints, columns=columns)
    sockets = rig.tests.touch.sockets if rig.tests.touch else ()
    if not socket and len(sockets) != 1:
        declared = f", of {', '.join(sockets)}" if sockets else ""
        problem = "does not name the socket of each row"
        remedy = f"add a column socket, or give --socket NAME for all rows{declared}"
        raise FileError(raw.where, problem, remedy, code="table.invalid")
    constants = {SOCKET: socket or sockets[0]}
    return TableMap(files=(layout,), joints=joints, columns=columns, constants=constants)


def _raw_table(data: bytes, where: str) -> tuple[RawTable, FileLayout]:
    lines, text_layout = text_of(data, where)
    layout = layout_of(lines, text_layout.encoding, where)
    return read_raw(lines, layout, where), layout


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
            raw.where, problem, f"name the columns q1_deg … q{axes}_deg, or J1 … J{axes}", code="table.invalid"
        )
    return likely_angles(raw, group)


@dataclass(frozen=True)
class RunLabels:
    """Labels of a run and the joint columns to use, which its table does not state."""

    direction: Direction | None = None
    operator: str = ""
    placement: str = ""
    joints: JointSource = "measured"


def read_table(source: Path, rig_file: str | Path, test: TestName, labels: RunLabels) -> Measured:
    """Run of a table file, not written to disk. Its doubts include reasons for which an evaluation would reject it."""
    rig, rig_text = load(rig_file)
    with named_by(rig_file, rig):
        require_instruments(rig, test)
    read = read_file(source, test, rig, labels.direction, labels.joints)
    run = table_run(
        source,
        read.table,
        test=test,
        direction=read.direction,
        rig_name=rig.name,
        rig_text=rig_text,
        operator=labels.operator,
        source=source.name,
        source_sha256=read.sha256,
        placement=labels.placement,
        only_commanded=labels.joints == "commanded" and MEASURED[0] not in read.table.column_names,
    )
    return _check_against_rig(run, rig, str(source), read.doubts)


def is_plain(path: Path, test: TestName) -> bool:
    """True for the columns of docs/tables.md, and for a bag of a circle: both are read without a map."""
    head = read_head(path)
    if reader_of(head):
        return test != MAPPED
    names, required = header_names(head), set(format_of(test).layout().required)
    ours = names & required
    if test != MAPPED or len(ours) < 2:
        return len(ours) > 1
    # Joints named by rig with places in foreign columns, such as tvec_x … of OpenCV, need a map, as do columns in other
    # units (x_m), and a second place, which the controller may have computed.
    stems = [name.rpartition("_") for name in required - names]
    has_units = any(f"{stem}_{unit}" in names for stem, _, our_unit in stems for unit in TO_UNIT[our_unit])
    has_two_places = count_places(names - {*CONTROLLER_PLACE}) > 1 and head.count(b"\n") > FEWEST
    return bool(ours - set(PLACE) and ours & set(PLACE)) and not has_units and not has_two_places


def propose_map(files: Sequence[Path], rig_file: str | Path, join: str = "", topic: str = "") -> MapProposal:
    """Propose which column of a pose measurement is what, checked with the rig's arm.

    topic: topic of the poses in a bag, if it has several. Raises FileError if the files do not fit the arm.
    """
    return _propose(files, load(rig_file)[0], join, topic)[0]


def poses_of_controller(files: Sequence[Path], rig: Rig) -> MappedPoses:
    """Poses that the controller computed, also if the table has measured poses next to them."""
    proposal, raw = _propose(files, rig, "", "")
    for question in [question for question in proposal.questions if question.key == "place"]:
        proposal = proposal.answered(question, question.readings[-1])
    if proposal.questions:
        problem = f"has columns of unclear meaning ({proposal.asks})"
        raise FileError(str(files[0]), problem, "add the units to the header", code="table.unclear")
    poses = poses_of(raw, proposal.table_map)
    if poses.controller_mm is None:
        return poses
    return replace(poses, xyz_mm=poses.controller_mm, turn=poses.controller_turn)


def _propose(files: Sequence[Path], rig: Rig, join: str, topic: str) -> tuple[MapProposal, RawTable]:
    _refuse_rail(rig, str(files[0]))
    tables, layouts = [], []
    for path in files:
        data, chosen, _ = _text_of_file(read_whole(path), str(path), rig, topic)
        sheet = ""
        if is_workbook(data):
            sheets = sheets_of(data, str(path))
            if len(sheets) != 1:
                fact = f"has {len(sheets)} sheets with rows ({', '.join(map(repr, sheets))}) instead of one"
                remedy = "save that sheet as CSV, or name it in a map: files: [{sheet: NAME}]"
                raise FileError(str(path), fact, remedy, code="table.unclear")
            sheet, data = next(iter(sheets.items()))
        table, layout = _raw_table(data, str(path))
        tables.append(table)
        layouts.append(layout.model_copy(update={"sheet": sheet, "topic": chosen}))
    raw, _ = joined(tables, join)
    return propose(raw, layouts, join, rig), raw


def _text_of_file(data: bytes, where: str, rig: Rig, topic: str) -> tuple[bytes, str, tuple[str, ...]]:
    """Table of the stationary poses in a bag, the topic and the doubts; tables in other formats as CSV."""
    if reader := reader_of(data):
        stands = reader.stands_of(data, where, rig, topic)
        return stands.text, stands.topic, stands.doubts
    if topic:
        problem = f"applies only to bags, and {where} is not a bag"
        raise UseError("--topic", problem, "remove it")
    text = csv_of(data, where)
    return text, "", cut_off_doubts(text)


def _refuse_rail(rig: Rig, where: str) -> None:
    if rig.robot.rail:
        problem = "has columns other than those of docs/tables.md, but a map cannot give the position of the rail"
        raise FileError(where, problem, "name the columns q1_deg …, e1_mm, x_mm, y_mm, z_mm", code="table.invalid")


def read_mapped(
    files: Sequence[Path], table_map: TableMap, rig_file: str | Path, test: TestName, labels: RunLabels
) -> Measured:
    """Run of the files of a measurement read with their map, not written to disk; see `read_table`."""
    rig, rig_text = load(rig_file)
    where = str(files[0])
    if len(files) != len(table_map.files):
        fact = f"describes {len(table_map.files)} files, but {len(files)} are given"
        remedy = "give the files of one measurement in order; several are joined (--join)"
        raise FileError("the map", fact, remedy, code="table.unclear")
    if labels.joints == "commanded" and not table_map.only_commanded:
        if table_map.commanded is None:
            fact = "does not name commanded joints, which --joints commanded needs"
            raise FileError("the map", fact, "add `commanded`", code="table.invalid")
        table_map = table_map.model_copy(update={"joints": table_map.commanded, "commanded": None})
    data = [read_whole(path) for path in files]
    _refuse_rail(rig, where)
    texts, doubts = list[tuple[Path, bytes]](), list[str]()
    for path, content, layout in zip(files, data, table_map.files, strict=True):
        text, _, of_file = _text_of_file(content, str(path), rig, layout.topic)
        texts.append((path, text))
        doubts += of_file
    raw, left_out = read_files(texts, table_map.files, table_map.join)
    doubts += [f"{left_out} rows are in only one of the files, and are ignored"] if left_out else []
    if table_map.stops and table_map.place:
        raw = with_joints(raw, table_map.place, cube_of(rig))
    table = table_by(raw, table_map, test, len(rig.robot.axes), labels.direction)
    problems, columns = Problems(), dict(zip(table.column_names, table.columns, strict=True))
    problems.add(check_sequence(columns, raw.lines, test, rig, labels.direction))
    problems.refuse(where)
    digests = [hashlib.sha256(content).hexdigest() for content in data]
    run = table_run(
        files[0],
        table,
        test=test,
        direction=table["direction"][0].as_py() if "direction" in format_of(test).layout().required else None,
        rig_name=rig.name,
        rig_text=rig_text,
        operator=labels.operator,
        source=" + ".join(path.name for path in files),
        source_sha256=digests[0] if len(digests) == 1 else hashlib.sha256("".join(digests).encode()).hexdigest(),
        placement=labels.placement,
        table_map=map_text(table_map),
        assumed=table_map.assumed,
        only_commanded=table_map.only_commanded,
    )
    return _check_against_rig(run, rig, where, doubts)


def _check_against_rig(run: Run, rig: Rig, where: str, doubts: Iterable[str]) -> Measured:
    measured = measured_of(run, rig)
    refuse_impossible(measured, where)
    refused, table = [], measured.table
    try:
        kind_of(table.test).require_evaluable(table, rig, where)
        columns = zip(format_of(table.test).gauges, table.readings.T, strict=False)
        require_live_gauges(where, **{f"{gauge}_mm": column for gauge, column in columns})
    except FileError as error:  # report it now
        refused = [str(error)]
    reasons = (*doubts, *refused, *measured.doubts)
    return replace(measured, doubts=doubts_of(replace(measured, doubts=reasons)))


_GIVE_TEST = "choose the test: rig import --test, or test= in Python"
_FEW_MISSING = 2
"""Largest number of missing columns that are named. Chosen: with more, the table is of a different kind."""


def read_any_table(source: Path, rig_file: str | Path, test: TestName | None, labels: RunLabels) -> Measured:
    """Run of any table, not written to disk. test: inferred from the columns if None.

    Raises FileError also if only an operator could interpret the columns.
    """
    rig = load(rig_file)[0]
    kind = test_of(source, rig) if test is None else test
    if needs_touch_map(source, kind, ""):
        return read_mapped([source], propose_touch_map(source, rig, kind, ""), rig_file, kind, labels)
    if kind != MAPPED or is_plain(source, kind):
        return read_table(source, rig_file, kind, labels)
    proposal = propose_map([source], rig_file)
    if proposal.questions:
        problem = f"has open questions ({proposal.asks})"
        raise FileError(str(source), problem, "answer the questions of rig import", code="table.unclear")
    return read_mapped([source], proposal.assumed().table_map, rig_file, kind, labels)


def test_of(source: Path, rig: Rig) -> TestName:
    """Test of a table by its columns. Raises FileError if several tests match, or none."""
    where, axes, head = str(source), len(rig.robot.axes), read_head(source)
    if reader_of(head):
        raise FileError(where, "is a bag, which may contain poses or a circle", _GIVE_TEST, code="table.unclear")
    if is_workbook(head) and not is_convertible(head):
        return MAPPED
    names = header_names(head)
    layouts = {test: set(format_of(test).layout(axes).required) - {"direction"} for test in TESTS}
    ours = [test for test, required in layouts.items() if required <= names]
    ours = [test for test in ours if not any(layouts[test] < layouts[other] for other in ours)]
    if len(ours) == 1:
        return ours[0]
    if ours:
        raise FileError(
            where, f"may belong to {' or '.join(ours)}, which have the same columns", _GIVE_TEST, code="table.unclear"
        )
    if any(name.lower() == SOCKET for name in names):
        return next(filter(_is_of_touches, TESTS))
    raw, _ = _raw_table(read_text(source), where)
    groups = groups_of(raw, [axis.name for axis in rig.robot.axes])
    if groups.joints and groups.seen:
        return MAPPED
    nearest = min(layouts, key=lambda test: len(layouts[test] - names))
    missing = sorted(layouts[nearest] - names)
    if len(missing) <= _FEW_MISSING:
        problem = f"lacks {' and '.join(missing)} of a {nearest} table"
        remedy = "add the column, or run rig import --help for other tables"
        raise FileError(where, problem, remedy, code="table.invalid")
    problem = f"has columns that match none of the tests: {', '.join(raw.names[:20])}"
    raise FileError(where, problem, _GIVE_TEST, code="table.unclear")
