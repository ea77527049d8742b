"""Creation of runs from table files, including checks against the rig."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from analysis.intake.cells import Problems, TableFileError
from analysis.intake.column_groups import count_places, groups_of
from analysis.intake.cube_stops import with_joints
from analysis.intake.map_proposal import MapProposal, propose
from analysis.intake.mapped import MappedPoses, poses_of, table_by
from analysis.intake.raw_table import RawTable, is_workbook, joined, layout_of, read_files, read_raw, sheets_of, text_of
from analysis.intake.read import check_sequence, header_names, read_file, read_head, read_whole
from analysis.intake.readers import reader_of
from analysis.intake.table_map import MAPPED, TO_UNIT, TableMap, map_text
from analysis.intake.touch_map import needs_touch_map, propose_touch_map
from analysis.procedures.checks.check_runs import doubts_of, refuse_impossible
from analysis.procedures.checks.meanings import FEWEST
from analysis.procedures.shared.test_kind import kind_of, require_live_gauges
from analysis.robot.geometry.iso_cube import cube_of
from analysis.runs.loading import Measured, measured_of
from analysis.runs.table_format import TESTS, format_of
from analysis.runs.table_layout import CONTROLLER_PLACE, MEASURED, PLACE, SOCKET, JointSource
from daq.store import Run, table_run
from rigs.errors import FileError, UseError
from rigs.load import load, named_by
from rigs.readiness import require_instruments
from rigs.rig import Rig
from rigs.schema.vocabulary import Direction, TestName


def read_table(
    source: Path,
    *,
    rig_file: str | Path,
    test: TestName,
    direction: Direction | None,
    operator: str,
    placement: str = "",
    joints: JointSource = "measured",
) -> Measured:
    """Run of a table file, not written to disk. The doubts include reasons for which an evaluation would
    reject it.

    Raises FileError for mistakes in the table or the rig file.
    """
    rig, rig_text = load(rig_file)
    with named_by(rig_file, rig):
        require_instruments(rig, test)
    read = read_file(source, test, rig, direction, joints)
    run = table_run(
        source,
        read.table,
        test=test,
        direction=read.direction,
        rig_name=rig.name,
        rig_text=rig_text,
        operator=operator,
        source=source.name,
        source_sha256=read.sha256,
        placement=placement,
        only_commanded=joints == "commanded" and MEASURED[0] not in read.table.column_names,
    )
    return _check_against_rig(run, rig, str(source), read.doubts)


def is_plain(path: Path, test: TestName) -> bool:
    """True if a file starts with the columns of docs/tables.md, or is a bag of a circle, which can be read
    directly.
    """
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
    """Propose the column map of the files of a pose measurement, checked with the arm of a rig file.

    topic: topic of the poses in a bag, if it has several. Raises FileError if the files are not such a table, or do not
    fit the arm.
    """
    return _proposed(files, load(rig_file)[0], join, topic)[0]


def poses_of_controller(files: Sequence[Path], rig: Rig) -> MappedPoses:
    """Controller-computed poses, read with the map proposed for the arm of a rig, also if the table has
    measured poses next to them. Raises FileError.
    """
    proposal, raw = _proposed(files, rig, "", "")
    computed = [question for question in proposal.questions if question.key == "place"]
    for question in computed:
        proposal = proposal.answered(question, question.readings[-1])
    if proposal.questions:
        asks = "; ".join(f"{question.key}: {question.asks}" for question in proposal.questions)
        raise FileError(
            str(files[0]),
            f"has columns of unclear meaning ({asks})",
            "add the units to the header",
            code="table.column_unclear",
        )
    poses = poses_of(raw, proposal.table_map)
    if poses.controller_mm is None:
        return poses
    return replace(poses, xyz_mm=poses.controller_mm, turn=poses.controller_turn)


def _proposed(files: Sequence[Path], rig: Rig, join: str, topic: str) -> tuple[MapProposal, RawTable]:
    _refuse_rail(rig, str(files[0]))
    tables, layouts = [], []
    for path in files:
        data, chosen, _ = _stands_in(read_whole(path), str(path), rig, topic)
        sheet = ""
        if is_workbook(data):
            sheets = sheets_of(data, str(path))
            if len(sheets) != 1:
                fact = f"has {len(sheets)} sheets with rows ({', '.join(map(repr, sheets))}) instead of one"
                raise FileError(
                    str(path),
                    fact,
                    "save that sheet as CSV, or name it in a map: files: [{sheet: NAME}]",
                    code="workbook.several_sheets",
                )
            sheet, data = next(iter(sheets.items()))
        lines, text_layout = text_of(data, str(path))
        layout = layout_of(lines, text_layout.encoding, str(path)).model_copy(update={"sheet": sheet, "topic": chosen})
        layouts.append(layout)
        tables.append(read_raw(lines, layout, str(path)))
    raw, _ = joined(tables, join)
    return propose(raw, layouts, join, rig), raw


def _stands_in(data: bytes, where: str, rig: Rig, topic: str) -> tuple[bytes, str, tuple[str, ...]]:
    """Table of the stationary poses in a bag, the topic and the doubts; other files unchanged."""
    if reader := reader_of(data):
        stands = reader.stands_of(data, where, rig, topic)
        return stands.text, stands.topic, stands.doubts
    if topic:
        raise UseError(
            "--topic", f"applies only to bags, and {where} is not a bag", "remove it", code="import.bags_only"
        )
    return data, "", ()


def _refuse_rail(rig: Rig, where: str) -> None:
    if rig.robot.rail:
        problem = "has columns other than those of docs/tables.md, but a map cannot give the position of the rail"
        raise FileError(where, problem, "name the columns q1_deg …, e1_mm, x_mm, y_mm, z_mm", code="map.no_positions")


def read_mapped(  # noqa: PLR0913 - what a run is labelled with
    files: Sequence[Path],
    table_map: TableMap,
    *,
    rig_file: str | Path,
    test: TestName,
    direction: Direction | None,
    operator: str,
    placement: str = "",
    joints: JointSource = "measured",
) -> Measured:
    """Run of the files of a measurement read with their map, not written to disk; see `read_table`.

    Raises FileError for mistakes in a file, in the map or in the rig file.
    """
    rig, rig_text = load(rig_file)
    where = str(files[0])
    if len(files) != len(table_map.files):
        fact = f"describes {len(table_map.files)} files, but {len(files)} are given"
        raise FileError(
            "the map",
            fact,
            "give the files of one measurement in order; several are joined (--join)",
            code="workbook.several_sheets",
        )
    if joints == "commanded" and not table_map.only_commanded:
        if table_map.commanded is None:
            raise FileError(
                "the map",
                "does not name commanded joints, which --joints commanded needs",
                "add `commanded`",
                code="table.not_commanded",
            )
        table_map = table_map.model_copy(update={"joints": table_map.commanded, "commanded": None})
    data = [read_whole(path) for path in files]
    _refuse_rail(rig, where)
    stands = [
        _stands_in(content, str(path), rig, layout.topic)
        for path, content, layout in zip(files, data, table_map.files, strict=True)
    ]
    raw, left_out = read_files(
        [(path, text) for path, (text, *_) in zip(files, stands, strict=True)], table_map.files, table_map.join
    )
    if table_map.stops and table_map.place:
        raw = with_joints(raw, table_map.place, cube_of(rig))
    table = table_by(raw, table_map, test, len(rig.robot.axes), direction)
    problems = Problems()
    problems.add(
        check_sequence(dict(zip(table.column_names, table.columns, strict=True)), raw.lines, test, rig, direction)
    )
    if problems.count:
        raise TableFileError(where, problems.first, count=problems.count)
    digests = [hashlib.sha256(content).hexdigest() for content in data]
    run = table_run(
        files[0],
        table,
        test=test,
        direction=table["direction"][0].as_py() if "direction" in format_of(test).layout().required else None,
        rig_name=rig.name,
        rig_text=rig_text,
        operator=operator,
        source=" + ".join(path.name for path in files),
        source_sha256=digests[0] if len(digests) == 1 else hashlib.sha256("".join(digests).encode()).hexdigest(),
        placement=placement,
        table_map=map_text(table_map),
        assumed=table_map.assumed,
        only_commanded=table_map.only_commanded,
    )
    doubts = [doubt for *_, of_file in stands for doubt in of_file]
    doubts += [f"{left_out} rows are in only one of the files, and are ignored"] if left_out else []
    return _check_against_rig(run, rig, where, doubts)


def _check_against_rig(run: Run, rig: Rig, where: str, doubts: Iterable[str]) -> Measured:
    """Check a run against the rig, and add reasons for a later rejection to the doubts."""
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


def read_any_table(source: Path, *, rig_file: str | Path, test: TestName | None, **label: Any) -> Measured:
    """Run of any table, not written to disk.

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
    """Test of a table, inferred from the columns. Raises FileError if several tests match, or none."""
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
