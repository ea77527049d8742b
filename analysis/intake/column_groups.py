"""Candidate columns by their names: joints, places, orientations. `map_proposal` decides among them with the arm."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import permutations
from typing import Literal

import numpy as np

from analysis.intake.raw_table import RawTable
from analysis.intake.table_map import Unit
from analysis.intake.table_problems import Problems
from rigs.errors import FileError

Role = Literal["measured", "commanded", "residual", "other", "unsaid"]
_ROLE_WORDS: dict[Role, str] = {
    "other": "std stdev sd sigma u unc uncertainty cov var rms speed speeds vel velocity velocities qd qdd "
    "acc acceleration accelerations current currents torque "
    "torques effort force forces moment moments temp temperature tau",
    "residual": "dif diff difference err error errors dev deviation residual res delta",
    "commanded": "goal target targets desired des cmd command commanded nominal nom ref reference soll sollwert "
    "planned consigne consigna teorico théorique 名义",
    "measured": "measured measurement meas actual act tracker leica laser faro lt ist istwert observed mocap camera "
    "mesuré mesurée medido misurato 测量",
}
_INSTRUMENTS = (
    "measured measurement meas tracker leica laser faro lt istwert observed mocap camera smr tmac mesuré mesurée "
    "medido misurato 测量"
)
_INSTRUMENT = frozenset(_INSTRUMENTS.split())
_OF_ROBOTS = "tcp tool ee eef flange robot cartesian controller fk wrist hand gripper link effector broadcaster"
_CONTROLLER = frozenset(_OF_ROBOTS.split())
"""Terms for a pose reported by the robot, unless the name of an instrument is present."""
_SPOTS = frozenset(["spot", "spots", "floor", "mark", "marks", "punch", "socket", "sockets"])
"""Terms for places touched by the tool and not measured by an instrument."""
_ROLES: dict[Role, frozenset[str]] = {role: frozenset(words.split()) for role, words in _ROLE_WORDS.items()}
_UNITS = {
    "mm": "mm", "millimeter": "mm", "millimetre": "mm", "m": "m", "meter": "m", "metre": "m", "cm": "cm", "um": "um",
    "µm": "um", "in": "in", "inch": "in", "deg": "deg", "degree": "deg", "degrees": "deg", "°": "deg", "rad": "rad",
    "radian": "rad", "radians": "rad", "gon": "gon", "turn": "turn", "turns": "turn", "rev": "turn",
}  # fmt: skip
_JOINTS = "q j joint joints axis a theta th rax ax jt jnt position pos angle angles achse gelenk axe 축 관절 轴 关节"
_JOINT_WORDS = frozenset(_JOINTS.split())
_TURNS = "r rot rotation orientation euler angle angles rotvec rvec rv e o ori quat quaternion q rpy"
_TURN_WORDS = frozenset(_TURNS.split())
_SETS = {"rpy": ("roll", "pitch", "yaw"), "abc": ("a", "b", "c"), "wpr": ("w", "p", "r"), "oat": ("o", "a", "t")}
"""Names of angle triples: common, KUKA, FANUC and Kawasaki."""
_UR_NAMES = (
    ("base", "shoulder", "elbow", "wrist1", "wrist2", "wrist3"),
    ("shoulderpan", "shoulderlift", "elbow", "wrist1", "wrist2", "wrist3"),
)
_A_CALL = 3
"""Minimum length of an axis name searched for: shorter ones occur in ordinary words."""
_NAMELESS = re.compile(r"column \d+( \(.*\))?")
"""Name of a column without a header."""
_ORDERS = tuple("".join(order) for order in permutations("xyz"))
_ZYZ = ("zyz", "zxz")
_TRIPLES = 12
"""Largest number of places tried among unnamed columns, each in every unit."""


@dataclass(frozen=True)
class TurnReading:
    """Columns as an orientation, in the order of the form (`analysis.intake.table_map.TurnColumns`)."""

    columns: tuple[str, ...]
    form: str


@dataclass(frozen=True)
class ColumnGroup:
    columns: tuple[str, ...]
    role: Role
    unit: Unit = ""
    """As stated in the file, of all columns or of each; "" if unknown."""
    of_controller: bool = False
    """Whether the name suggests that the robot computed the values."""
    of_instrument: bool = False


@dataclass(frozen=True)
class PlaceColumns:
    place: ColumnGroup
    turns: tuple[TurnReading, ...] = ()
    turn_unit: str = ""


@dataclass(frozen=True)
class Groups:
    joints: tuple[ColumnGroup, ...]
    seen: tuple[PlaceColumns, ...]
    residuals: tuple[ColumnGroup, ...]
    near: tuple[str, ...] = ()
    """Joint columns for a different number of axes, mentioned in an error message."""


@dataclass(frozen=True)
class _Name:
    column: str
    words: tuple[str, ...]
    unit: str

    @property
    def role(self) -> Role:
        return next((role for role, role_words in _ROLES.items() if role_words & set(self.words)), "unsaid")


def is_of_controller(name: str) -> bool:
    """True if the name of a topic, column or child frame suggests a pose reported by the robot."""
    words = set(_name(name, "").words)
    return bool(words & _CONTROLLER) and not words & _INSTRUMENT


def is_of_spot(column: str) -> bool:
    return bool(set(_name(column, "").words) & _SPOTS)


def is_nameless(column: str) -> bool:
    return bool(_NAMELESS.fullmatch(column))


def count_places(columns: Iterable[str]) -> int:
    names = [name for name in (_name(column, "") for column in columns) if name.role not in ("other", "residual")]
    return len(_lettered(names)[0])


def _refuse_repeated(raw: RawTable, joints: Sequence[ColumnGroup]) -> None:
    """Refuse a second column "J1 (2)" next to "J1"; columns "J (1)" to "J (6)" are numbered by the user."""
    plain = [{name: re.sub(r" \(\d+\)$", "", name) for name in group.columns} for group in joints]
    repeated = [next((first for name, first in of.items() if name != first and first in of), "") for of in plain]
    if repeated and all(repeated):
        problem = f"has two columns {repeated[0]}"
        raise FileError(raw.where, problem, "give each joint column a unique name", code="table.invalid")


def groups_of(raw: RawTable, axis_names: Sequence[str]) -> Groups:
    numeric = set(raw.numeric)
    names = [_name(name, unit) for name, unit in zip(raw.names, raw.units, strict=True) if name in numeric]
    names = [name for name in names if name.role != "other"]
    named = [name for name in names if not is_nameless(name.column)]
    axes = len(axis_names)
    numbered = [_as_named(raw, group, axis_names) for group in _numbered(named, axes)]
    joints = list({group.columns: group for group in (*numbered, *_groups_by_axis_name(named, axis_names))}.values())
    near = tuple(name for count in (5, 7, 8) for group in _numbered(named, count) for name in group.columns)
    if not joints and not near:
        by_role: dict[Role, list[_Name]] = defaultdict(list)
        for name in named:
            if {"joint", "axis"} & set(name.words):
                by_role[name.role].append(name)
        joints = [_group(of_role) for of_role in by_role.values() if len(of_role) == axes]
        joints = joints or _numbered(named, axes, frozenset())
    taken = {column for group in joints for column in group.columns}
    unused = [name for name in named if name.column not in taken]
    places, turns = _lettered(unused)
    seen = []
    for place in (place for place in places if place.role != "residual"):
        alike = [turn for turn in turns if turn[0].role == place.role]
        units = {group.unit for group, _ in alike if isinstance(group.unit, str)}
        readings = tuple(reading for _, ways in alike for reading in ways)
        seen.append(PlaceColumns(place, readings, units.pop() if len(units) == 1 else ""))
    seen += _vectors(unused)
    residuals = tuple(place for place in places if place.role == "residual")
    used = (
        taken | {column for pose in seen for column in pose.place.columns} | {c for g in residuals for c in g.columns}
    )
    used |= {column for turn in turns for reading in turn[1] for column in reading.columns}
    if not joints or not seen:
        unexplained = [name.column for name in names if name.column not in used]
        more_joints, more_seen = _by_position(raw, unexplained, axes, not joints, not seen)
        joints, seen = [*joints, *more_joints], [*seen, *more_seen]
    _refuse_repeated(raw, joints)
    return Groups(tuple(joints), tuple(seen), residuals, near)


def _as_named(raw: RawTable, group: ColumnGroup, axis_names: Sequence[str]) -> ColumnGroup:
    """Numbered joint columns in the order of the axes, if other columns contain the joint names.

    `rostopic echo -p` writes a JointState as field.name0 … and field.position0 …, in the order of the sender.
    """
    for word in ("position", "pos"):
        name_columns = [re.sub(rf"{word}(?=\W*\d+$)", "name", column) for column in group.columns]
        if all(name in raw.names and name != column for name, column in zip(name_columns, group.columns, strict=True)):
            axis_calls = [str(raw.cells[column][0].as_py()) for column in name_columns]
            order = dict(zip(axis_calls, group.columns, strict=True))
            called = [_name(name, "") for name in order]
            for ordered in (*_groups_by_axis_name(called, axis_names), *_numbered(called, len(axis_names))):
                return replace(group, columns=tuple(order[name] for name in ordered.columns))
    return group


def _name(column: str, unit_line: str) -> _Name:
    text = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", column)
    bracket = re.search(r"[\[(]\s*([^\])]*?)\s*[\])]", text)
    unit = ""
    if bracket and bracket[1].lower() in _UNITS:
        unit = _UNITS[bracket[1].lower()]
        text = text.replace(bracket[0], " ")
    words = re.findall(r"[^\W\d_]+|°|\d+", text.lower())
    if not unit and len(words) > 1 and words[-1] in _UNITS:
        unit = _UNITS[words.pop()]
    stated = unit_line.strip("[]() ").lower()
    return _Name(column, tuple(words), unit or _UNITS.get(stated, ""))


def _group(names: Sequence[_Name]) -> ColumnGroup:
    words = {word for name in names for word in name.words}
    of_instrument = bool(words & _INSTRUMENT)
    of_controller = bool(words & _CONTROLLER) and not of_instrument
    columns, units = tuple(name.column for name in names), tuple(name.unit for name in names)
    stated = {*units} - {""}
    unit: Unit = units if len(stated) > 1 and "" not in units else stated.pop() if len(stated) == 1 else ""
    return ColumnGroup(columns, names[0].role, unit, of_controller, of_instrument)


def _templates(names: Sequence[_Name]) -> dict[tuple[str, ...], dict[int, _Name]]:
    templates: dict[tuple[str, ...], dict[int, _Name]] = defaultdict(dict)
    for name in names:
        digits = [k for k, word in enumerate(name.words) if word.isdigit() and len(word) < 3]
        if digits:
            k = digits[-1]
            templates[(*name.words[:k], "*", *name.words[k + 1 :])].setdefault(int(name.words[k]), name)
    return templates


def _in_order(numbered: dict[int, _Name], count: int) -> list[_Name] | None:
    for first in (0, 1):
        if sorted(numbered) == list(range(first, first + count)):
            return [numbered[k] for k in sorted(numbered)]
    return None


def _numbered(names: Sequence[_Name], count: int, words_of_joints: frozenset[str] = _JOINT_WORDS) -> list[ColumnGroup]:
    """Columns numbered consecutively from 0 or 1, whose names contain one of the words unless there are none."""
    groups = []
    for template, numbered in _templates(names).items():
        words = {word for word in template if word != "*"}
        order = _in_order(numbered, count)
        if order and (words & words_of_joints or not words_of_joints) and not words & {"pose", "tcp"}:
            groups.append(_group(order))
    return groups


def _groups_by_axis_name(names: Sequence[_Name], axis_names: Sequence[str]) -> list[ColumnGroup]:
    """Columns named after the axes of the arm or of a Universal Robots arm, in any order.

    The columns of a message are often sorted alphabetically.
    """
    groups = []
    call_sets = [tuple(re.sub(r"[^a-z0-9]", "", name.lower()) for name in axis_names)]
    call_sets += [calls for calls in _UR_NAMES if len(calls) == len(axis_names)]
    for calls in dict.fromkeys(call_sets):
        if len(set(calls)) < len(calls) or min(map(len, calls)) < _A_CALL:
            continue
        alike: dict[tuple[Role, str], dict[str, _Name]] = defaultdict(dict)
        for name in names:
            whole = "".join(name.words)
            for call in sorted(calls, key=len, reverse=True):
                if call in whole:
                    alike[(name.role, whole.replace(call, "*", 1))].setdefault(call, name)
                    break
        complete = (by_call for by_call in alike.values() if len(by_call) == len(calls))
        groups += [_group([by_call[call] for call in calls]) for by_call in complete]
    return list({group.columns: group for group in groups}.values())


_Turns = list[tuple[ColumnGroup, tuple[TurnReading, ...]]]
"""Columns of an orientation, with the possible interpretations."""


def _lettered(names: Sequence[_Name]) -> tuple[list[ColumnGroup], _Turns]:
    """Places and orientations by letters or words: x, y, z; qx … qw; roll, pitch, yaw; A, B, C."""
    turns = _in_sets(names)
    taken = {column for group, _ in turns for column in group.columns}
    places = []
    # Columns x, y, z, and w if present, grouped by the rest of the name.
    parts: dict[tuple[str, ...], dict[str, _Name]] = defaultdict(dict)
    for name in names:
        for k, word in enumerate(name.words):
            if word[-1] in "xyzw" and (len(word) < 3 or word[:-1] in {*_TURN_WORDS, "pos", "trans", "tcp"}):
                parts[(*name.words[:k], f"{word[:-1]}*", *name.words[k + 1 :])].setdefault(word[-1], name)
    for template, by_letter in parts.items():
        if not set("xyz") <= by_letter.keys():
            continue
        group, w = _group([by_letter[letter] for letter in "xyz"]), by_letter.get("w")
        if w and w.column not in taken:
            turns.append((group, (TurnReading((*group.columns, w.column), "quaternion"),)))
        elif {word.rstrip("*") for word in template} & _TURN_WORDS:
            turns.append((group, _angle_readings(group.columns)))
        else:
            places.append(group)
    # Quaternions q1 … q4, with the real part first or last.
    for template, numbered in _templates(names).items():
        order = _in_order(numbered, 4)
        if order and {"q", "quat", "quaternion"} & set(template):
            first, *later = (name.column for name in order)
            ways = (TurnReading(columns, "quaternion") for columns in ((*later, first), (first, *later)))
            turns.append((_group(order), tuple(ways)))
    words = {"r", "rot", "m", "t", "matrix", "rotation"}
    if rows := _matrix_of(_by_digits(name for name in names if words & set(name.words)), 3):
        group = _group([name for row in rows for name in row])
        turns.append((group, (TurnReading(group.columns, "matrix"),)))
    return places, turns


def _in_sets(names: Sequence[_Name]) -> _Turns:
    """Orientations named by three words (`_SETS`), about x, y and z except for KUKA and Kawasaki."""
    sets: dict[tuple[str, ...], dict[str, _Name]] = defaultdict(dict)
    for name in names:
        for k, word in enumerate(name.words):
            for call, members in _SETS.items():
                if word in members:
                    sets[(call, *name.words[:k], "*", *name.words[k + 1 :])].setdefault(word, name)
    whole = {key: [by_word[word] for word in _SETS[key[0]]] for key, by_word in sets.items() if len(by_word) == 3}
    turns: _Turns = []
    for (call, *_), names_of_set in whole.items():
        columns = tuple(name.column for name in names_of_set)
        readings: tuple[TurnReading, ...] = (TurnReading(columns, "moving zyz"),)  # Kawasaki
        if call != "oat":
            readings = _angle_readings(columns)
        if call == "abc":  # A, B, C of KUKA turn about z, y, x
            readings = (*_angle_readings(columns[::-1]), *readings)
        turns.append((_group(names_of_set), readings))
    return turns


def _angle_readings(columns: Sequence[str]) -> tuple[TurnReading, ...]:
    """Three angles about x, y and z in every order of moving axes, and as a rotation vector."""
    by_axis, whole = dict(zip("xyz", columns, strict=True)), tuple(columns)
    moving = {order: TurnReading(tuple(by_axis[axis] for axis in order), f"moving {order}") for order in _ORDERS}
    moving["zyx"] = TurnReading(whole, "fixed xyz")  # the same, by its common name roll, pitch, yaw
    return (*moving.values(), TurnReading(whole, "rotation vector"))


def _by_digits(names: Iterable[_Name]) -> dict[str, _Name]:
    named = (("".join(word for word in name.words if word.isdigit()), name) for name in names)
    return {digits: name for digits, name in named if len(digits) == 2}


def _matrix_of(by_digits: dict[str, _Name], columns: int) -> list[list[_Name]]:
    """The three rows of a complete matrix, numbered from 0 or 1; empty if there is none."""
    for first in (0, 1):
        rows = [[f"{row}{column}" for column in range(first, first + columns)] for row in range(first, first + 3)]
        if all(place in by_digits for row in rows for place in row):
            return [[by_digits[place] for place in row] for row in rows]
    return []


def _vectors(names: Sequence[_Name]) -> Iterator[PlaceColumns]:
    """Poses with numbered columns: 6 (place and angles), 7 (place and quaternion), 12 or 16 (matrix)."""
    for numbered in _templates(names).values():
        for count in (6, 7, 12, 16):
            if order := _in_order(numbered, count):
                whole = _group(order)
                for seen in _poses([name.column for name in order]):
                    yield replace(seen, place=replace(whole, columns=seen.place.columns, unit=""))
    if rows := _matrix_of(_by_digits(names), 4):
        turn = tuple(name.column for row in rows for name in row[:3])
        yield PlaceColumns(_group([row[3] for row in rows]), (TurnReading(turn, "matrix"),))


def _poses(columns: Sequence[str]) -> Iterator[PlaceColumns]:
    c = tuple(columns)

    def pose(place: Sequence[str], *turns: TurnReading) -> PlaceColumns:
        return PlaceColumns(ColumnGroup(tuple(place), "unsaid"), turns)

    def matrix(*places: int) -> TurnReading:
        return TurnReading(tuple(c[k] for k in places), "matrix")

    match len(c):
        case 3:
            yield pose(c)
        case 6:
            # Names do not indicate the axes of these three angles.
            turned = (TurnReading(c[3:], f"moving {order}") for order in (*_ORDERS, *_ZYZ))
            yield pose(c[:3], *dict.fromkeys((*_angle_readings(c[3:]), *turned)))
        case 7:
            x, y, z, w = c[3:]
            yield pose(c[:3], TurnReading((x, y, z, w), "quaternion"), TurnReading((y, z, w, x), "quaternion"))
        case 12 | 16:
            yield pose(c[3:12:4], matrix(0, 1, 2, 4, 5, 6, 8, 9, 10))
            if len(c) == 16:
                yield pose(c[12:15], matrix(0, 4, 8, 1, 5, 9, 2, 6, 10))
            else:
                yield pose(c[9:], matrix(*range(9)))


def _by_position(
    raw: RawTable, columns: list[str], axes: int, joints: bool, seen: bool
) -> tuple[list[ColumnGroup], list[PlaceColumns]]:
    """Unnamed columns as joints, before or after the pose, and as poses; each only if wanted (`joints`, `seen`)."""
    is_first = columns[:1] == [raw.names[0]] and len(columns) - int(joints) * axes in (4, 7, 8, 13, 17)
    if is_first or (columns and (np.diff(raw.numbers(columns[:1], Problems())[:, 0]) == 1).all()):
        columns = columns[1:]  # a counter or a time
    pose = len(columns) - axes if joints else len(columns)
    if not joints:
        return [], list(_poses(columns)) or _triples(columns)
    if not seen or pose == 0:
        return [ColumnGroup(tuple(columns), "unsaid")] if pose == 0 else [], []
    if pose < 3:
        return [], []
    groups = [ColumnGroup(tuple(columns[:axes]), "unsaid"), ColumnGroup(tuple(columns[pose:]), "unsaid")]
    places = [*_poses(columns[axes:]), *_poses(columns[:pose])]
    return groups, places or [*_triples(columns[axes:]), *_triples(columns[:pose])]


def _triples(columns: Sequence[str]) -> list[PlaceColumns]:
    """Every three adjacent columns as a place, for tables with counters, uncertainties or times without names."""
    return [PlaceColumns(ColumnGroup(tuple(columns[k : k + 3]), "unsaid")) for k in range(len(columns) - 2)][:_TRIPLES]
