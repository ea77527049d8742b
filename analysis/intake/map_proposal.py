"""Proposal of a column map, checked by a fit of the nominal arm to the places, with free base and target.

The right unit leaves some mm, a wrong one decimetres or metres. An interpretation is accepted if it fits clearly better
than the next; all other cases become questions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.intake.column_groups import (
    ColumnGroup,
    Groups,
    PlaceColumns,
    groups_of,
    is_nameless,
    is_of_controller,
    is_of_spot,
)
from analysis.intake.mapped import MappedPoses, poses_of, radians, with_joints
from analysis.intake.raw_table import RawTable
from analysis.intake.table_map import (
    ANGLE_UNITS,
    TO_DEG,
    TO_MM,
    Angles,
    FileLayout,
    Lengths,
    Residual,
    TableMap,
    TurnColumns,
    line_of_map,
)
from analysis.intake.table_problems import TableFileError
from analysis.intake.table_reading import (
    COMPUTED_MM,
    LENGTHS,
    FittingPlace,
    Judge,
    Question,
    TableReading,
    alternative_readings,
    column_span,
    fits_in_parts,
    in_each_unit,
    likely_angles,
    plausibility_key,
    possible_units,
    searched_readings,
    separate_places,
)
from analysis.procedures.checks.columns import (
    AS_WELL,
    CLEARLY,
    FEWEST,
    HOMED,
    MOST_ZERO_DEG,
    RIGHT_MM,
    fit_nearest,
    right_mm,
)
from analysis.procedures.checks.places import NO_INSTRUMENT_MM, OF_CONTROLLER, SPARE
from analysis.robot.geometry.iso_cube import cube_of
from analysis.robot.geometry.pose_setup import fit_arm, fit_setup, position_error
from analysis.robot.kinematics.arm import Arm, arm_of, forward, without_setup
from analysis.runs.stands import require_postures
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.text import as_argument, first_of

_JUDGED = 200
"""Number of evenly selected rows used to compare interpretations; more rows add little."""
_STEPS = 100
_KEPT = 0.8
_RIGHT_DEG = 2.0
"""Largest residual of an orientation; that of a nominal arm is some tenths of a degree."""
_SHARE_OF_CONSTANTS = 0.8
"""Smallest share of the residual that fitted constants leave of computed places (F = 3, p = 0.001 for 25 poses)."""
_FEW_POSTURES = 20
"""With few postures the fit of instrument and target removes most of the error."""
_FLOOR_MM, _FLOOR_DEG = 0.05, 0.01
"""Residual below which a fit cannot improve: rounding and noise."""
_SHOWN, _NAMED = 6, 30
_SMALL_MM = 100.0
"""Spread of places (rms) below which a wrong interpretation may also fit within 10 mm."""
_FAULTY_SHARE = 0.05
"""Largest relative residual of a faulty arm. A zero wrong by 2.5° moves places by 0.044 of the lever."""


@dataclass(frozen=True)
class MapProposal:
    table_map: TableMap
    """The map, with the likeliest value of open keys."""
    questions: tuple[Question, ...]
    checked: tuple[str, ...]
    """Results of the checks as text."""
    rows: int

    @property
    def asks(self) -> str:
        return "; ".join(f"{question.key}: {question.asks}" for question in self.questions)

    def answered(self, question: Question, reading: TableReading) -> MapProposal:
        table_map = self.table_map.model_copy(update={question.key: reading.value})
        maps = tuple(one for one in question.maps if getattr(one, question.key) == reading.value)
        questions = []
        for other in (one for one in self.questions if one is not question):
            readings = other.readings
            if maps and other.maps:
                values = [getattr(one, other.key) for one in maps]
                readings = tuple(one for one in readings if one.value in values)
            if len(readings) == 1:
                table_map = table_map.model_copy(update={other.key: readings[0].value})
            else:
                questions.append(replace(other, readings=readings, maps=maps or other.maps))
        return replace(self, table_map=table_map, questions=tuple(questions))

    def assumed(self) -> MapProposal:
        """Proposal with the likeliest answer to every question; the map records the assumptions."""
        words = [f"{one.key}: {one.readings[0].words} was assumed and is not confirmed" for one in self.questions]
        assumed = {"assumed": (*self.table_map.assumed, *words)}
        return replace(self, table_map=self.table_map.model_copy(update=assumed), questions=())


def propose(raw: RawTable, layouts: Sequence[FileLayout], join: str, rig: Rig) -> MapProposal:
    """Propose which column of a pose table is what, by the fit to the rig's arm.

    Raises FileError if columns of joints or places are missing, or if no interpretation fits the arm.
    """
    names = [axis.name for axis in rig.robot.axes]
    groups = groups_of(raw, names)
    stops = _stops_of_cube(raw, groups, rig)
    if stops is not None:
        proposal = propose(stops, layouts, join, rig)
        finding = "joints missing: the rows are stops of the ISO 9283 cube of the rig file, identified by place"
        table_map = proposal.table_map.model_copy(update={"stops": "of the cube"})
        return replace(proposal, table_map=table_map, checked=(finding, *proposal.checked))
    groups = _without_spots(raw, groups)
    _refuse_missing(raw, groups, len(names))
    bare = without_setup(arm_of(rig.robot))
    judge = Judge(raw.evenly(_JUDGED), bare, tuple(layouts), join)
    if len(raw.lines) < FEWEST:
        problem = f"has {len(raw.lines)} poses, too few to determine the meaning of the columns ({FEWEST} are needed)"
        raise FileError(raw.where, problem, _map_by_hand(raw, groups, layouts), code="readings.too_few")
    joints, commanded = _joints_to_read(groups)
    for group in joints[:1]:
        require_postures(radians(judge.raw, likely_angles(judge.raw, group)), raw.where)
    seen, residual = _places_to_read(groups)
    measured, computed = (seen, None) if residual else separate_places(judge, joints, groups, seen)
    table_map, chosen = _map_places(judge, joints, measured, residual)
    only_commanded = all(group.role == "commanded" for group in joints)
    table_map = table_map.model_copy(update={"only_commanded": only_commanded})
    if commanded and table_map.joints and len(commanded) == 1:
        (unit, *_) = possible_units(commanded[0].unit, TO_DEG, (table_map.joints.unit,))
        table_map = table_map.model_copy(update={"commanded": Angles(columns=commanded[0].columns, unit=unit)})
    if computed:
        table_map = _with_controller(judge, table_map, computed)
    of_controller = table_map.controller_turn.columns if table_map.controller_turn else ()
    turns = tuple(turn for turn in chosen.turns if not set(turn.columns) & set(of_controller))
    if turns and table_map.turn is None:
        table_map = _map_turn(judge, table_map, replace(chosen, turns=turns))
    if table_map.residual:
        judge.questions.append(_sign_question(table_map.residual))
    if judge.assumed:
        table_map = table_map.model_copy(update={"assumed": tuple(judge.assumed)})
    return MapProposal(table_map, tuple(judge.questions), tuple(judge.checked), len(raw.lines))


def _joints_to_read(groups: Groups) -> tuple[list[ColumnGroup], list[ColumnGroup]]:
    measured, unsaid, commanded = (
        [group for group in groups.joints if group.role == role] for role in ("measured", "unsaid", "commanded")
    )
    return (measured or unsaid, commanded) if measured or unsaid else (commanded, [])


def _sign_question(residual: Residual) -> Question:
    """Both signs of a residual fit equally well: a wrong sign mirrors the errors."""
    span = column_span(residual.columns)
    readings = (
        TableReading(residual.model_copy(update={"meaning": meaning}), np.nan, "mm", f"{span} is {meaning}")
        for meaning in ("target - measured", "measured - target")
    )
    return Question("residual", "the file does not define the residual, and both readings fit the arm", tuple(readings))


def _map_by_hand(raw: RawTable, groups: Groups, layouts: Sequence[FileLayout]) -> str:
    """Remedy for a table without a proposed map, with the map itself if the header states all units."""
    command = f"rig import {as_argument(raw.where)} --rig RIG --test pose --map MAP.yaml -o RUN"
    joints, places = groups.joints[:1], [pose.place for pose in groups.seen[:1]]
    if not all(group.unit for group in (*joints, *places)) or not (joints and places):
        return f"write a map by hand (MAP.yaml), and run {command}"
    of_groups = (("joints", joints[0]), ("place", places[0]))
    columns = {name: {"columns": group.columns, "unit": group.unit} for name, group in of_groups}
    inline = line_of_map(TableMap.model_validate({"files": layouts, **columns}))
    return f"by the header the places are in {places[0].unit}: save {inline} as MAP.yaml, and run {command}"


def _stops_of_cube(raw: RawTable, groups: Groups, rig: Rig) -> RawTable | None:
    """A table of places with the joint angles of the declared cube; None if it has joints or no cube is declared.

    Raises FileError if the places are not those of the cube.
    """
    if groups.joints or groups.near or rig.tests.iso9283 is None:
        return None
    seen = [pose.place for pose in groups.seen if pose.place.role != "commanded"]
    cube, failed = cube_of(rig) if seen else None, None
    for place, unit in ((group, unit) for group in seen for unit in possible_units(group.unit, TO_MM, LENGTHS)):
        try:
            return with_joints(raw, Lengths(columns=place.columns, unit=unit), cube) if cube else None
        except TableFileError:
            raise
        except FileError as error:
            failed = failed or error
    if failed:
        raise failed
    return None


def _without_spots(raw: RawTable, groups: Groups) -> Groups:
    seen = tuple(pose for pose in groups.seen if not all(map(is_of_spot, pose.place.columns)))
    if groups.seen and not seen:
        spots = column_span(groups.seen[0].place.columns)
        problem = f"has only positions of spots ({spots}) touched by the tool, but none measured by an instrument"
        remedy = "name the spot of each row in a column socket, and import the table with --test touch"
        raise FileError(raw.where, problem, remedy, code="table.invalid")
    return replace(groups, seen=seen)


def _refuse_missing(raw: RawTable, groups: Groups, axes: int) -> None:
    has = f"the numeric columns are {first_of(raw.numeric, _NAMED)}"
    if not groups.joints:
        if groups.near:
            nears = f"{len(groups.near)} columns of joints ({groups.near[0]} … {groups.near[-1]})"
            problem = f"has {nears}, but the arm of the rig file has {axes} axes"
            raise FileError(raw.where, problem, "give the rig file of the measured arm", code="table.unclear")
        problem = f"has no {axes} columns that may be joints; {has}"
        remedy = (
            "add the joint angles of each pose (several files: --join), or name them in a map (--map); stops of the "
            "ISO 9283 cube need only tests.iso9283 in the rig file"
        )
        raise FileError(raw.where, problem, remedy, code="table.invalid")
    if not any(pose.place.role != "commanded" for pose in groups.seen) and not (groups.seen and groups.residuals):
        if raw.socket_column and not groups.seen:
            problem = (
                f"has a column {raw.socket_column} and no measured place: these are touches, not poses of a tracker"
            )
            raise FileError(raw.where, problem, "import it with --test touch", code="table.invalid")
        lacks = (
            "has only places that were commanded, not measured" if groups.seen else "lacks columns x, y, z of a place"
        )
        raise FileError(raw.where, f"{lacks}; {has}", "name the measured ones in a map (--map)", code="table.invalid")


def _places_to_read(groups: Groups) -> tuple[list[PlaceColumns], ColumnGroup | None]:
    """Places to read, and the residual columns to add if no column contains measured places."""
    apart = [pose for pose in groups.seen if not pose.place.of_controller and pose.place.role != "commanded"]
    seen = apart or groups.seen  # poses reported by the robot only if nothing else was measured
    measured = [pose for pose in seen if pose.place.role == "measured"]
    unsaid = [pose for pose in seen if pose.place.role == "unsaid"]
    commanded = [pose for pose in groups.seen if pose.place.role == "commanded"]
    if measured:
        return measured, None
    if len(groups.residuals) == 1 and len(commanded or unsaid) == 1:
        return commanded or unsaid, groups.residuals[0]
    return unsaid, None


def _map_places(
    judge: Judge, joints: Sequence[ColumnGroup], seen: Sequence[PlaceColumns], residual: ColumnGroup | None
) -> tuple[TableMap, PlaceColumns]:
    """Map of joints and place, and the selected place. Open points become questions of the judge."""
    candidates = _unit_readings(judge, joints, seen, residual, stated=True)
    overruled = None
    if not candidates[0][0].fits:
        unstated = _unit_readings(judge, joints, seen, residual, stated=False)
        if unstated[0][0].fits:
            overruled, candidates = candidates[0], unstated
        else:
            candidates = sorted(
                [*_seen_from_tool(judge, joints, seen), *candidates], key=lambda candidate: candidate[0].share
            )
            if not candidates[0][0].fits and residual is None:
                overruled, candidates = _with_alternatives(judge, joints, seen, candidates)
    (best, chosen), *others = candidates
    judge.checked.append(best.line(others[0][0] if others else None))
    if not best.fits:
        _accept_faulty_arm(judge, best, [reading for reading, _ in candidates])
    least = max(best.share, best.share * _FLOOR_MM / max(best.left, 1e-9))
    rivals = [candidate for candidate in others if candidate[0].share < CLEARLY * least]
    disagrees = "the header or the order of the columns disagrees with the arm; which is correct?"
    if best.value.joints.zeros_deg:
        disagrees = "the joints fit the arm only with different zeros; does only the table use them?"
        if homed := best.remedy.partition(HOMED)[2]:
            disagrees += f" If the arm itself was homed there, do not import, but {homed}"
    fit = "more than one reading fits the arm; which is correct?"
    stated = [overruled] if overruled else []
    asked = [candidates[0], *rivals]
    # Zeros of the arm itself are faults, which an assumed map would hide: as named comes first.
    asked = [*stated, *asked] if HOMED in best.remedy else [*asked, *stated]
    _ask_keys(judge, asked, disagrees if overruled else fit)
    named = next((layout.topic for layout in judge.layouts if is_of_controller(layout.topic)), "")
    if residual is None and candidates[0][0] is best and best.left < _SMALL_MM * best.share:
        best = _check_small_motion(judge, candidates[0])
    if chosen.place.of_controller or named:
        words = f"the robot computed the poses, so they are not a measurement: do not import; {OF_CONTROLLER}"
        by_robot = TableReading(None, np.nan, "mm", words)
        measured = TableReading(best.value.place, best.left, "mm", "an instrument measured the poses")
        asks = (
            f"{named or column_span(chosen.place.columns)} looks like poses reported by the robot; who measured them?"
        )
        judge.questions.append(Question("place", asks, (by_robot, measured)))
    elif residual is None and best.left < COMPUTED_MM and _is_nominal(judge.bare, poses_of(judge.raw, best.value)):
        judge.assumed.append(
            f"the places lie within {best.left:.2g} mm (rms) of the nominal arm, too close for a real arm: they "
            "may be computed by the controller, or simulated"
        )
    table_map: TableMap = best.value
    return table_map, chosen


def _accept_faulty_arm(judge: Judge, best: TableReading, readings: Sequence[TableReading]) -> None:
    """Accept an interpretation that does not fit the nominal arm as that of a faulty arm.

    Raises FileError if it fits in parts, if another one fits clearly better, or if the error is too large for any arm.
    """
    plain = next(reading for reading in readings if reading.value.sees == "the tool")
    if part := fits_in_parts(judge.raw, judge.bare, plain.value):
        problem = f"fits the arm of the rig file in {part}, but not completely; {plain.line()}"
        remedy = "give measurements with a different place of target or instrument as separate files, one run each"
        raise FileError(judge.raw.where, problem, remedy, code="table.unclear")
    nominal = f"{right_mm(best.left / best.share) if best.share else RIGHT_MM:.3g} mm over these places"
    if judge.zeros:
        judge.assumed.append(f"{best.line()}; {judge.zeros}: these zeros, or a length, are far wrong; diagnose the run")
        return
    if best.share > min(_FAULTY_SHARE, AS_WELL * min(reading.share for reading in readings)):
        problem = f"does not fit the arm of the rig file, in any reading of the columns, to {nominal}; {best.line()}"
        remedy = (
            "no order, signs, zeros or usual units of the columns fit either: check that the rig file belongs to the "
            "arm; otherwise write a map by hand (--map)"
        )
        raise FileError(judge.raw.where, problem, remedy, code="table.unclear")
    judge.assumed.append(
        f"{best.line()}; the nominal constants of an arm leave at most {nominal}; no reading "
        "fits clearly better: a zero or a length of this arm is far wrong, or the rig file is that of a different arm"
    )


def _is_nominal(bare: Arm, poses: MappedPoses) -> bool:
    """True if there are enough postures, and fitted constants hardly improve the fit."""
    q, xyz_mm = poses.q, poses.xyz_mm
    if len(np.unique(np.round(q, 2), axis=0)) <= _FEW_POSTURES:
        return False
    T, fitted = forward(bare, q), fit_arm(bare, q, xyz_mm)
    error = position_error(T, xyz_mm, fit_setup(T, xyz_mm))
    nominal_mm = float(np.sqrt((error**2).sum() / (len(q) - 3)))
    return fitted.spare < SPARE or max(fitted.rms_mm, NO_INSTRUMENT_MM) > _SHARE_OF_CONSTANTS * nominal_mm


def _check_small_motion(judge: Judge, taken: tuple[TableReading, PlaceColumns]) -> TableReading:
    """Likeliest interpretation of poses with small joint motion.

    Another one that fits clearly better becomes a question. If both fit equally, the column names are trusted and the
    assumption is recorded.
    """
    best, seen = taken
    ways = alternative_readings(judge.raw, judge.bare, best.value)
    if not ways:
        return best
    first = ways[0]
    if CLEARLY * max(first.left, _FLOOR_MM) < best.left and not first.remedy:
        second = replace(first, words=f"{best.words}, with {first.words}")
        asks = "the joints hardly move, and a different reading fits better; which is correct?"
        _ask_keys(judge, [(second, seen), taken], asks)
        return second
    if first.left < CLEARLY * max(best.left, _FLOOR_MM):
        judge.assumed.append(
            f"the joints move too little to show order and signs of the columns ({first.words} fits to "
            f"{first.left:.2g} mm, as named to {best.left:.2g} mm): they are taken as they are named"
        )
    return best


def _ask_keys(judge: Judge, candidates: Sequence[tuple[TableReading, PlaceColumns]], asks: str) -> None:
    maps = tuple(reading.value for reading, _ in candidates)
    for key in ("joints", "place", "turn", "sees"):
        values: dict[str, TableReading] = {}
        for reading, _ in candidates:
            value = getattr(reading.value, key)
            values.setdefault(repr(value), replace(reading, value=value))
        readings = tuple(values.values())[:_SHOWN]
        if len(readings) > 1:
            judge.questions.append(Question(key, asks, readings, maps))


def _unit_readings(
    judge: Judge,
    joints: Sequence[ColumnGroup],
    seen: Sequence[PlaceColumns],
    residual: ColumnGroup | None,
    *,
    stated: bool,
) -> list[tuple[TableReading, PlaceColumns]]:
    candidates = []
    for pose, angles, lengths, words in in_each_unit(joints, seen, stated=stated):
        of_residual = None
        if residual:
            (unit, *_) = possible_units(residual.unit if stated else "", TO_MM, (lengths.unit,))
            of_residual = Residual(columns=residual.columns, unit=unit, meaning="target - measured")
        candidates.append((judge.reading(judge.map_of(angles, lengths, of_residual), words), pose))
    return _ranked(judge, candidates)


def _ranked(
    judge: Judge, candidates: list[tuple[TableReading, PlaceColumns]]
) -> list[tuple[TableReading, PlaceColumns]]:
    candidates.sort(key=lambda candidate: candidate[0].share)
    best = [(judge.reading(reading.value, reading.words, _STEPS), pose) for reading, pose in candidates[:_SHOWN]]
    return sorted(best, key=lambda candidate: candidate[0].share) + candidates[_SHOWN:]


def _seen_from_tool(
    judge: Judge, joints: Sequence[ColumnGroup], seen: Sequence[PlaceColumns]
) -> list[tuple[TableReading, PlaceColumns]]:
    """Interpretations for an instrument on the tool, such as the camera of hand-eye pairs."""
    candidates = []
    for pose, angles, lengths, words in in_each_unit(joints, seen, ("mm", "m")):
        for turn in _turns(pose):
            table_map = judge.map_of(angles, lengths, turn=turn, sees="from the tool")
            with_turn = f"seen from the tool: {words}, turn as {_turn_words(turn)}"
            candidates.append((judge.reading(table_map, with_turn), pose))
    return _ranked(judge, candidates)


def _with_alternatives(
    judge: Judge,
    joints: Sequence[ColumnGroup],
    seen: Sequence[PlaceColumns],
    candidates: list[tuple[TableReading, PlaceColumns]],
) -> tuple[tuple[TableReading, PlaceColumns] | None, list[tuple[TableReading, PlaceColumns]]]:
    """Add reordered or reversed columns and a left-handed frame: first if one fits, otherwise last.

    Also gives the interpretation as named that a fitting one replaces. Raises FileError if only a change of the rig
    file would fit.
    """
    ways = []
    for pose, angles, lengths, named in in_each_unit(joints, seen):
        base = judge.map_of(angles, lengths)
        ways += [(way, base, named, pose) for way in alternative_readings(judge.raw, judge.bare, base)]
    closest = min((way[0].share for way in ways), default=0.0)
    ways.sort(key=lambda way: plausibility_key(way[0], closest))
    # A zero wrong by 180° is equivalent to a reversed next axis; a map can state the latter.
    if any(way[0].share < AS_WELL * ways[0][0].share and not way[0].remedy for way in ways):
        ways = [way for way in ways if not way[0].remedy]
    read = [(replace(way, words=f"{named}, with {way.words}"), pose) for way, _, named, pose in ways]
    if not read or not read[0][0].fits:
        searched, as_named = _searched(judge, joints, seen)
        return (as_named, [*searched, *candidates]) if searched else (None, [*candidates, *read])
    best, base, named, pose = ways[0]
    if best.remedy:
        problem = f"fits the arm of the rig file only with {best.words}; {read[0][0].line()}"
        raise FileError(judge.raw.where, problem, best.remedy, code="table.unclear")
    return (judge.reading(base, named, _STEPS), pose), [*read, *candidates]


def _searched(
    judge: Judge, joints: Sequence[ColumnGroup], seen: Sequence[PlaceColumns]
) -> tuple[list[tuple[TableReading, PlaceColumns]], tuple[TableReading, PlaceColumns] | None]:
    """Readings in other units, or with other signs and zeros of several joints, and the reading as named."""
    for pose, angles, lengths, named in in_each_unit(joints, seen, angle_units=(*TO_DEG,)):
        base = judge.map_of(angles, lengths)
        as_named = judge.reading(base, named, _STEPS)
        if as_named.fits:
            return [(as_named, pose)], None
        if found := searched_readings(judge.raw, judge.bare, base):
            if found[0].value.joints.has_small_zeros(MOST_ZERO_DEG):
                judge.zeros = f"with {found[0].words} they fit to {found[0].left:.2g} mm"
                return [(as_named, pose)], None
            return [(replace(way, words=f"{named}, with {way.words}"), pose) for way in found], (as_named, pose)
    return [], None


def _turns(seen: PlaceColumns) -> list[TurnColumns]:
    turns = []
    for reading in seen.turns:
        if reading.form in ("quaternion", "matrix"):
            turns.append(TurnColumns(columns=reading.columns, form=reading.form))
        else:
            for unit in possible_units(seen.turn_unit, TO_DEG, ANGLE_UNITS):
                turns.append(TurnColumns(columns=reading.columns, form=reading.form, unit=unit))
    return turns


def _turn_words(turn: TurnColumns) -> str:
    words = f"{turn.form} {column_span(turn.columns)}"
    return f"{words} in {turn.unit}" if turn.unit else words


def _with_controller(judge: Judge, table_map: TableMap, computed: FittingPlace) -> TableMap:
    """The map with the pose that the controller computed, and with its orientation if one reading fits."""
    place = computed.reading.value.place
    readings = _turn_readings(judge, computed.reading.value, computed.pose)
    turn = readings[0].value if readings and readings[0].left <= _RIGHT_DEG and not _rivals(readings) else None
    columns = f"{column_span(place.columns)}{f' and {column_span(turn.columns)}' if turn else ''}"
    judge.checked.append(f"{columns}: computed by the controller, kept as controller_x_mm …, and not used as measured")
    return table_map.model_copy(update={"controller": place, "controller_turn": turn})


def _turn_readings(judge: Judge, table_map: TableMap, seen: PlaceColumns) -> list[TableReading]:
    """Distinct readings of the orientation of a place, best first.

    Their residual is that of the best four fifths, after a fit of the tool orientation on the flange.
    """
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - slow to import, needed here only

    base = poses_of(judge.raw, table_map)
    setup = fit_nearest(judge.bare, base.q, base.xyz_mm, _STEPS)[1]
    to_flange = Rotation.from_matrix(setup.T_world_base[:3, :3] @ forward(judge.bare, base.q)[:, :3, :3]).inv()
    candidates: list[tuple[TableReading, Rotation]] = []
    for turn in _turns(seen):
        try:
            turns = poses_of(judge.raw, table_map.model_copy(update={"turn": turn})).turn
        except TableFileError:
            continue
        assert turns is not None  # noqa: S101 - of readings with a turn
        tool, off, kept = to_flange * turns, np.empty(0), np.arange(len(base.q))
        for _ in range(3):
            off = np.asarray((tool * tool[kept].mean().inv()).magnitude())
            kept = np.argsort(off)[: max(int(_KEPT * len(off)), 6)]
        rms_deg = float(np.degrees(np.sqrt(np.mean(off[kept] ** 2))))
        candidates.append((TableReading(turn, rms_deg, "°", f"turn as {_turn_words(turn)}"), turns))
    readings, distinct = list[TableReading](), list[Rotation]()
    for reading, turns in sorted(candidates, key=lambda candidate: candidate[0].left):
        if all((turns * earlier.inv()).magnitude().max() > 1e-6 for earlier in distinct):
            readings.append(reading)
            distinct.append(turns)
    return readings


def _rivals(readings: Sequence[TableReading]) -> list[TableReading]:
    return [reading for reading in readings[1:] if reading.left < CLEARLY * max(readings[0].left, _FLOOR_DEG)]


def _map_turn(judge: Judge, table_map: TableMap, seen: PlaceColumns) -> TableMap:
    readings = _turn_readings(judge, table_map, seen)
    if not readings:
        return table_map
    best, *others = readings
    judge.checked.append(best.line(others[0] if others else None))
    none = TableReading(None, np.nan, "°", "turn missing: only places are imported")
    rivals = _rivals(readings)
    if best.left > _RIGHT_DEG and all(map(is_nameless, best.value.columns)):
        return table_map  # other numbers next to the place, such as its uncertainties
    if best.left > _RIGHT_DEG:
        asks = f"the readings of the turn do not fit the arm within {_RIGHT_DEG:g}°; ignore the turn, or use which?"
        judge.questions.append(Question("turn", asks, (none, *readings[:_SHOWN])))
        return table_map
    if rivals:
        asks = "more than one reading of the turn fits the arm; which is correct?"
        judge.questions.append(Question("turn", asks, (best, *rivals[:_SHOWN], none)))
    return table_map.model_copy(update={"turn": best.value})
