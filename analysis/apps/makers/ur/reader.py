"""Reader of targets in URScript: joint lists in rad, and poses p[x, y, z, rx, ry, rz] in m and rad.

Targets are in moves or in variables. Source: Universal Robots, Script Manual (e-Series, 5.x). Poses refer to the base.
movel and movec keep the current posture of the arm, and get_inverse_kin selects the solution closest to qnear. For a
waypoint NAME, PolyScope writes a pose NAME_p and the taught joint angles NAME_q, which serve only as qnear of a joint
move (scripts of PolyScope 5 in public repositories). A script is a single file.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field, replace

import numpy as np

from analysis.apps.makers.numbers import Decimals, frame_of
from analysis.apps.makers.points import Points, as_value
from analysis.apps.makers.program_machine import (
    OFF,
    Blocks,
    Call,
    Elsewhere,
    End,
    ForgetAll,
    Move,
    Program,
    Ref,
    Set,
    Statement,
    Unknown,
    Value,
)
from analysis.apps.makers.program_reader import ProgramReader, Remark
from analysis.apps.makers.target import (
    NUMBER,
    Form,
    LineNumbers,
    NamedFrame,
    Notice,
    Number,
    Parsed,
    ProgramTexts,
    Target,
    UncorrectedTarget,
    Way,
    arguments,
    blanked,
    brackets,
    in_one_line,
    lines_of,
    numbers_in,
    with_newlines,
    words,
)
from analysis.apps.makers.ur.derived_poses import DerivedPose, PoseReader, pairs_in
from analysis.apps.makers.ur.handed_points import (
    NAME_OR_POSE,
    Argument,
    CallSite,
    HandedPoints,
    Routine,
    parameter_key,
    routines_in,
    traced,
)
from analysis.correction.reasons import Reason

_DECIMALS = Decimals(place=(8, 10), turn=(8, 10))
"""Decimals of corrected numbers: 1e-8 m is 0.01 µm. PolyScope writes at least twelve decimals."""
_QUOTED = re.compile(r"\"[^\"\n]*\"|'[^'\n]*'")
_BLANK = re.compile(rf"#[^\n]*|{_QUOTED.pattern}|^[ \t]*\$[^\n]*", re.MULTILINE)
_DECLARED = re.compile(
    r"^[ \t]*(?:global[ \t]+|local[ \t]+)?(?P<name>[A-Za-z_]\w*)[ \t]*=[ \t]*(?P<kind>p?)\[(?P<list>[^\[\]\n]*)\]"
    r"[ \t]*$",
    re.MULTILINE,
)
_NUMBER_DECLARED = re.compile(
    rf"^[ \t]*(?:global[ \t]+|local[ \t]+)?([A-Za-z_]\w*)[ \t]*=[ \t]*({NUMBER})[ \t]*$", re.MULTILINE
)
_DERIVED = re.compile(
    r"^[ \t]*(?P<scope>global[ \t]+|local[ \t]+)?(?P<name>[A-Za-z_]\w*)[ \t]*=[ \t]*"
    r"(?P<pose>(?:pose_trans|pose_add)[ \t]*\(|p\[)",
    re.MULTILINE,
)
_REACHED = re.compile(
    r"\b(?:movej|movel|movep|movec|servoj|servoc|optimovej|optimovel|get_inverse_kin)\s*\(\s*"
    r"(?:\w+\s*=\s*)?([A-Za-z_]\w*)\s*[,)]"
)
_POSE = re.compile(r"(?<!\w)p\[([^\[\]]*)\]")
_PART_DECLARED = re.compile(
    r"(?<![\w.])(?P<name>[A-Za-z_]\w*(?:\.\w+|\[[^\[\]\n]*\])+)[ \t]*=[ \t]*p?\[(?P<list>[^\[\]]*)\]"
)
"""Numbers assigned to a part of a struct or of a list."""
_EVENT = re.compile(
    r"\b(?P<routine>def|thread|sec)[ \t]+(?P<name>[A-Za-z_]\w*)[ \t]*(?P<parameters>\([^()\n]*\))?[ \t]*:"
    r"|\brun[ \t]+(?P<run>[A-Za-z_]\w*)"
    r"|(?<![\w.])(?P<flow>(?:end|if|elif|else|while|return|break|continue|halt)(?!\w)"
    r"|(?:for|switch|case|default)\b(?=[^\n=]*:[ \t]*$))"
    r"|(?<![\w.])(?P<call>[A-Za-z_]\w*)[ \t]*\("
    r"|(?P<mark>[:\n])"
)
_WRITTEN = re.compile(r"(?<![\w.])([A-Za-z_]\w*)\s*(?:\[[^\[\]\n]*\]\s*|\.\w+\s*)*=(?!=)")
_WAYS: dict[str, Way] = {
    "movej": "joint", "movel": "line", "movep": "line", "movec": "line", "servoj": "joint", "servoc": "line",
    "optimovej": "joint", "optimovel": "line",
}  # fmt: skip
_KEEPS = "posture of the way"
"""Name of a part of the state that is always off.

The text does not specify the posture at the end of a line, or of a joint move to a bare pose. The arm keeps the current
posture, even on the way to a waypoint with taught joint angles.
"""
_MODE, _MODE_PLACE = re.compile(r"mode\s*=\s*(.*)", re.DOTALL), 5
"""The mode of movec(pose_via, pose_to, a, v, r, mode)."""
_STREAMED = ("servoj", "servoc")
"""Moves that the next statement does not wait for: the arm has not reached the target yet."""
_SWITCHES = {
    "path_offset_enable": ("shift", "on"), "path_offset_disable": ("shift", OFF),
    "track_conveyor_linear": ("tracking", "on"), "track_conveyor_circular": ("tracking", "on"),
    "stop_conveyor_tracking": ("tracking", OFF),
    "force_mode": ("tracking", "on"), "end_force_mode": ("tracking", OFF),
    "screw_driving": ("tracking", "on"), "end_screw_driving": ("tracking", OFF),
    "freedrive_mode": ("tracking", "on"), "end_freedrive_mode": ("tracking", OFF),
    "teach_mode": ("tracking", "on"), "end_teach_mode": ("tracking", OFF),
}  # fmt: skip
_ELSEWHERE = words("speedj speedl")
_NOTHING = words("""
    acos asin atan atan2 ceil cos d2r exp floor log pow r2d random sin sqrt tan abs and or not xor norm point_dist
    pose_add pose_dist pose_inv pose_sub pose_trans wrench_trans interpolate_pose inv transpose normalize
    get_list_length length size make_list struct get_matrix_dim binary_list_to_integer integer_to_binary_list
    rotvec2rpy rpy2rotvec to_num to_str to_int str_at str_cat str_empty str_find str_len str_sub tostr
    time sleep sync textmsg popup request_boolean_from_primary_client request_float_from_primary_client
    request_integer_from_primary_client request_string_from_primary_client protective_stop
    enter_critical exit_critical join kill stopj stopl is_within_safety_limits is_steady powerdown
    get_actual_joint_positions get_actual_joint_positions_history get_actual_joint_speeds get_actual_tcp_pose
    get_actual_tcp_speed get_actual_tool_flange_pose get_controller_temp get_conveyor_tick_count get_coordinated_joint
    get_forward_kin get_freedrive_status get_inverse_kin get_inverse_kin_has_solution get_joint_temp
    get_joint_torques get_steptime get_target_joint_positions get_target_joint_speeds get_target_joint_accelerations
    get_target_payload get_target_payload_cog get_target_payload_inertia get_target_tcp_pose get_target_tcp_speed
    get_target_waypoint get_tcp_force get_tcp_offset get_tool_accelerometer_reading get_tool_current
    get_tool_temp get_tool_voltage get_jacobian get_jacobian_time_derivative get_mass_matrix
    get_coriolis_and_centrifugal_torques get_friction_torques get_gravity_torques get_base_acceleration
    estimate_payload high_holding_torque_disable high_holding_torque_enable set_base_acceleration
    set_gravity set_payload set_payload_mass set_payload_cog set_target_payload set_payload_inertia
    set_safety_mode_transition_hardness position_deviation_warning zero_ftsensor ft_rtde_input_enable
    tool_contact collision_detection_enable
    force_mode_set_damping force_mode_set_gain_scaling
    path_offset_get path_offset_set path_offset_set_alpha_filter path_offset_set_max_offset
    conveyor_pulse_decode encoder_enable_pulse_decode encoder_enable_set_tick_count encoder_get_tick_count
    encoder_set_tick_count encoder_unwind_delta_tick_count set_conveyor_tick_count
    get_analog_in get_analog_out get_configurable_digital_in get_configurable_digital_out get_digital_in
    get_digital_out get_euromap_input get_euromap_output get_flag get_standard_analog_in get_standard_analog_out
    get_standard_digital_in get_standard_digital_out get_tool_analog_in get_tool_digital_in get_tool_digital_out
    set_analog_inputrange set_analog_out set_analog_outputdomain set_configurable_digital_input_action
    set_configurable_digital_out set_configurable_digital_output_action set_digital_out set_euromap_output
    set_euromap_runstate_dependent_choice set_flag set_gp_boolean_input_action set_gp_boolean_output_action
    set_input_actions_to_default set_output_actions_to_default set_runstate_configurable_digital_output_to_value
    set_runstate_gp_boolean_output_to_value set_runstate_standard_analog_output_to_value
    set_runstate_standard_digital_output_to_value set_runstate_tool_digital_output_to_value
    set_standard_analog_input_domain set_standard_analog_out set_standard_digital_input_action
    set_standard_digital_out set_standard_digital_output_action set_tool_analog_input_domain
    set_tool_analog_output_domain set_tool_communication set_tool_digital_input_action set_tool_digital_out
    set_tool_digital_output_action set_tool_digital_output_mode set_tool_output_mode set_tool_voltage
    modbus_add_signal modbus_delete_signal modbus_get_signal_status modbus_get_time_since_signal_invalid
    modbus_send_custom_command modbus_set_digital_input_action modbus_set_output_register modbus_set_output_signal
    modbus_set_runstate_dependent_choice modbus_set_signal_update_frequency modbus_set_signal_watchdog
    modbus_get_error_code modbus_get_signal_name read_input_boolean_register read_input_float_register
    read_input_integer_register read_output_boolean_register read_output_float_register
    read_output_integer_register read_port_bit read_port_register write_output_boolean_register
    write_output_float_register write_output_integer_register write_port_bit write_port_register
    force assert get_tool_digital_output_mode get_tool_output_mode
    rpc_factory rtde_set_watchdog socket_close socket_get_var socket_init socket_open socket_read_ascii_float
    socket_read_binary_integer socket_read_byte_list socket_read_line socket_read_string socket_send_byte
    socket_send_int socket_send_line socket_send_string socket_set_var
    """)
"""Functions with no effect on arm, tool and base: those of the manual that compute, read, write outputs and
registers, wait, or show messages. `get_inverse_kin` is a target if it is the argument of a move."""
_METHOD = re.compile(r"(?<![\w.])([A-Za-z_]\w*)[ \t]*\.[ \t]*([A-Za-z_]\w*)[ \t]*\(")
_OF_LISTS = words("append clear excluding extend insert pop remove slice length size to_string")
_NO_TARGETS = words("""
    set_tcp force_mode path_offset_set is_within_safety_limits
    get_inverse_kin_has_solution track_conveyor_linear track_conveyor_circular wrench_trans set_base_acceleration
    """)
"""Functions with poses as arguments that are not targets."""
_TARGET = re.compile(r"(?:q|pose|pose_via|pose_to|x)\s*=\s*")
_INVERSE = re.compile(r"get_inverse_kin\s*\(")
_WORD = re.compile(r"[A-Za-z_]\w*")
_LONGEST = 1000
"""Maximum length of a literal tool in characters; six numbers need less."""


@dataclass
class _UrReader:
    text: str
    lines: LineNumbers
    closes: dict[int, int]
    points: Points = field(default_factory=lambda: Points(1))
    joints: dict[str, tuple[float, ...]] = field(default_factory=dict)
    poses: dict[str, tuple[float, ...]] = field(default_factory=dict)
    spent: set[int] = field(default_factory=set)
    """Positions of point names in declarations and targets."""
    tools: dict[str, int] = field(default_factory=dict)
    """Positions of names passed to set_tcp."""
    reached: set[str] = field(default_factory=set)
    """Names passed to moves."""
    defined: Counter[str] = field(default_factory=Counter)
    routines: dict[str, tuple[Statement, ...]] = field(default_factory=dict)
    open: list[tuple[str, Blocks]] = field(default_factory=lambda: [("", Blocks())])
    beside: list[Call] = field(default_factory=list)
    outer: list[str] = field(default_factory=list)
    literals: set[int] = field(default_factory=set)
    """Positions of the poses in numbers that are points, tools, or listed."""
    listed: set[int] = field(default_factory=set)
    """Lines with a listed place."""
    all_routines: list[Routine] = field(default_factory=list)
    sites: dict[str, CallSite] = field(default_factory=dict)
    derived: dict[str, DerivedPose] = field(default_factory=dict)
    expressions: PoseReader | None = None

    def uncorrected_target(self, place: int, reason: Reason, name: str) -> UncorrectedTarget:
        self.listed.add(self.lines.at(place))
        return UncorrectedTarget(0, self.lines.at(place), name[:60], reason)

    def why(self, place: int, fact: str) -> Unknown:
        return Unknown(0, self.lines.at(place), fact)

    @property
    def blocks(self) -> Blocks:
        return self.open[-1][1]

    def routine_at(self, place: int) -> Routine | None:
        """Return the innermost routine at a position."""
        return next((one for one in reversed(self.all_routines) if one.begin <= place < one.end), None)

    def parameter(self, name: str, place: int) -> str:
        """Return the key of the parameter with this name at a position, or an empty string."""
        routine = self.routine_at(place)
        is_parameter = routine and name in routine.parameters and self.defined[routine.name] == 1
        return parameter_key(routine, name) if routine and is_parameter else ""


def parse(texts: ProgramTexts) -> Parsed:
    """Parse the targets of a script."""
    text = blanked(with_newlines(texts.texts[0]), _BLANK)
    closes = brackets(text)
    reader = _UrReader(in_one_line(text, closes), lines_of(text), closes)
    if odd := re.search("[\"']", _QUOTED.sub(lambda quoted: " " * len(quoted[0]), text)):
        _misread(reader, odd.start(), "a string does not end in its line")
    text = reader.text
    events = list(_EVENT.finditer(text))
    reader.defined.update(event["name"] for event in events if event["routine"])
    reader.all_routines = routines_in(events, len(text))
    _declare(reader, events)
    _other_computers(reader)
    # List the numbers of targets assigned to parts of structs and lists: moves to them are computed.
    for part in _PART_DECLARED.finditer(reader.text):
        numbers = numbers_in(reader.text, part.start("list"), part.end("list"))
        if numbers and len(numbers) == 6:
            reader.points.leave(reader.uncorrected_target(part.start(), "not_literal", part["name"]))
    _read(reader, events)
    _hand(reader)
    for name in reader.tools.keys() & reader.reached:
        reader.points.change(name, 0, reader.lines.at(reader.tools[name]))
    for word in NAME_OR_POSE.finditer(text):
        if reader.points.knows(word[0]) and word.start() not in reader.spent:
            reader.points.change(word[0], 0, reader.lines.at(word.start()))
        elif word[0] in reader.derived and word.start() not in reader.spent:
            _change_base(reader, reader.derived[word[0]], word.start())
    _other_poses(reader)
    # A script starts with the statements outside all routines or, if there are none, with the only outer routine.
    starts = "" if reader.routines[""] else reader.outer[0] if len(reader.outer) == 1 else None

    def initial(part: str) -> Value:
        return "tcp" if part == "tool" else OFF

    return reader.points.parsed(Program(reader.routines, initial, tuple(reader.beside), kept=("tool",), starts=starts))


def _other_computers(reader: _UrReader) -> None:
    """Add a notice for each function of another program called through a handle, such as rpc_factory."""
    seen: set[str] = set()
    for call in _METHOD.finditer(reader.text):
        name = f"{call[1]}.{call[2]}"
        if call[2] not in _OF_LISTS and name not in seen:
            seen.add(name)
            fact = f"{name} belongs to a different program: rig assumes that it neither moves the robot nor sets a tool"
            reader.points.notices.append(Notice(0, reader.lines.at(call.start()), fact))


def _declare(reader: _UrReader, events: list[re.Match[str]]) -> None:
    """Add the variables assigned with lists of six numbers. Only variables without other assignments are literals."""
    text = reader.text
    written = Counter(
        assignment[1]
        for assignment in _WRITTEN.finditer(text)
        if text[: assignment.start()].rstrip()[-1:] not in ("(", ",")
    )
    for event in events:
        written.update(_WORD.findall(event["parameters"] or ""))
    for declared in _DECLARED.finditer(text):
        numbers = numbers_in(text, declared.start("list"), declared.end("list"))
        name, pose = declared["name"], declared["kind"] == "p"
        if numbers is None or len(numbers) != 6:
            continue
        reader.spent.add(declared.start("name"))
        if written[name] == 1:
            (reader.poses if pose else reader.joints)[name] = tuple(number.value for number in numbers)
        reader.points.silent.update(() if pose else (name,))
        line = reader.lines.at(declared.start("name"))
        form: Form = "rotation_vector" if pose else "joints_rad"
        reader.literals.add(declared.start("list") - 2)
        reader.points.declare(name, Target(name, 0, line, form, numbers, "tcp", "base"))
    numbers_of = {found[1]: float(found[2]) for found in _NUMBER_DECLARED.finditer(text) if written[found[1]] == 1}

    def is_point(name: str, place: int) -> bool:
        return bool(reader.parameter(name, place)) or name in reader.poses

    reached = frozenset(_REACHED.findall(text))
    reader.expressions = PoseReader(text, reader.closes, numbers_of, reader.poses, is_point, reached, pairs_in(text))
    for found in _DERIVED.finditer(text):
        begin, end = found.start("pose"), reader.closes.get(found.end() - 1, -1) + 1
        if written[found["name"]] != 1 or text[end : text.find("\n", end) if "\n" in text[end:] else None].strip():
            continue
        pose = reader.expressions.derived(begin, end, reader.why(begin, "the offset is computed"))
        of_parameter = pose and reader.parameter(text[pose.begin : pose.end], pose.begin)
        if pose and not (of_parameter and (found["scope"] or "").startswith("global")):
            reader.derived[found["name"]] = pose
            reader.spent.add(found.start("name"))


def _change_base(reader: _UrReader, pose: DerivedPose, place: int) -> None:
    """Record that the script computes with a derived pose: its point may not change."""
    if reader.points.knows(name := reader.text[pose.begin : pose.end]):
        reader.points.change(name, 0, reader.lines.at(place))


def _hand(reader: _UrReader) -> None:
    """Let the moves of each routine go to the points that its calls hand to it."""
    keys = traced(reader.all_routines, reader.sites, reader.text, reader.spent)
    mentions = Counter(word[0] for word in _WORD.finditer(reader.text))
    calls = Counter(site.routine.name for site in reader.sites.values())
    for site in reader.sites.values():
        for name, argument in list(site.arguments.items()):
            is_literal = argument.key.startswith("\2")
            if parameter_key(site.routine, name) in keys:
                reader.spent.add(argument.place)
                if is_literal:
                    _declare_handed(reader, argument, site.routine.name)
                elif reader.points.knows(argument.key):
                    reader.reached.add(argument.key)
                continue
            del site.arguments[name]
            if is_literal:
                end = reader.closes[reader.text.index("[", argument.place)] + 1
                text = reader.text[argument.place : end]
                reader.points.leave(reader.uncorrected_target(argument.place, "handed", text))
    only = {name for name, count in calls.items() if mentions[name] == count + 1}
    plain = {site.routine.name for site in reader.sites.values() if not site.arguments}
    seen: set[tuple[int, str]] = set()

    def leave(move: Move) -> None:
        name = (move.base or move.key).rpartition(".")[2]
        if (move.line, name) not in seen:
            seen.add((move.line, name))
            reader.listed.add(move.line)
            reader.points.leave(UncorrectedTarget(0, move.line, name, "not_literal"))

    handed = HandedPoints(reader.routines, reader.sites, reader.points.joints, leave, _KEEPS)
    reader.routines = handed.replaced(only - plain)


def _declare_handed(reader: _UrReader, argument: Argument, name: str) -> None:
    literal = _list(reader.text, argument.place, reader.closes[reader.text.index("[", argument.place)] + 1)
    if literal:
        reader.literals.add(argument.place)
        form: Form = "rotation_vector" if literal[0] else "joints_rad"
        line = reader.lines.at(argument.place)
        reader.points.declare(argument.key, Target(name, 0, line, form, literal[1], "tcp", "base"))


def _other_poses(reader: _UrReader) -> None:
    """List the poses in numbers that are neither points nor tools, frames and offsets."""
    calls = [
        (call["call"], call.end(), end)
        for call in _EVENT.finditer(reader.text)
        if call["call"] and (end := reader.closes.get(call.end() - 1))
    ]
    for pose in _POSE.finditer(reader.text):
        numbers = numbers_in(reader.text, pose.start(1), pose.end(1))
        line = reader.lines.at(pose.start())
        if not numbers or len(numbers) != 6 or pose.start() in reader.literals or line in reader.listed:
            continue
        around = [name for name, begin, end in calls if begin <= pose.start() < end]
        if _NO_TARGETS.isdisjoint(around):
            is_handed = any(name in reader.defined or name not in _NOTHING for name in around)
            reason: Reason = "handed" if is_handed else "array" if _in_list(reader, pose.start()) else "computed"
            reader.points.leave(reader.uncorrected_target(pose.start(), reason, pose[0]))


def _in_list(reader: _UrReader, place: int) -> bool:
    return any(
        reader.text[opening] == "[" and opening + 1 != place + 2 and opening < place < end
        for opening, end in reader.closes.items()
    )


def _read(reader: _UrReader, events: list[re.Match[str]]) -> None:
    """Parse the statements in the order of execution: a call follows the evaluation of the arguments."""
    ordered = sorted(
        events, key=lambda event: reader.closes.get(event.end() - 1, 0) if event["call"] else event.start()
    )
    waiting = ""
    for event in ordered:
        if event["routine"]:
            if event["routine"] == "def" and len(reader.open) == 1:
                reader.outer.append(event["name"])
            reader.open.append((event["name"], Blocks()))
            if event["routine"] == "sec":
                reader.beside.append(Call(event["name"], reader.why(event.start(), f"{event['name']} runs beside")))
        elif event["run"]:
            reader.beside.append(Call(event["run"], reader.why(event.start(), f"{event['run']} runs beside")))
        elif event["call"]:
            _call(reader, event)
        elif event["mark"]:
            waiting = _mark(reader, event["mark"], waiting)
        else:
            waiting = _flow(reader, event, waiting)
    if len(reader.open) > 1 or reader.blocks.depth:
        _misread(reader, len(reader.text) - 1)
    while len(reader.open) > 1:
        _end_routine(reader)
    reader.routines[""] = reader.open[0][1].finish_routine()


def _mark(reader: _UrReader, mark: str, waiting: str) -> str:
    """Parse a colon or the end of a line, which completes a pending condition or return."""
    if mark == "\n":
        if waiting == "return":
            reader.blocks.add(End())
        return "" if waiting == "return" else waiting
    match waiting:
        case "if":
            reader.blocks.branch()
        case "switch":
            reader.blocks.cases()
        case "elif" | "case":
            reader.blocks.guard()
        case "while" | "for":
            reader.blocks.may_leave()
    return "" if waiting != "return" else waiting


def _flow(reader: _UrReader, event: re.Match[str], waiting: str) -> str:
    """Parse a keyword; return it if a colon or the end of the line has to complete it."""
    blocks, word = reader.blocks, event["flow"]
    if waiting == "return":
        blocks.add(End())
    match word:
        case "if" | "switch" | "return":
            return str(word)
        case "elif" | "case":
            blocks.other()
            return str(word)
        case "else" | "default":
            blocks.other()
        case "while" | "for":
            blocks.loop()
            return str(word)
        case "break":
            blocks.leave()
        case "continue":
            blocks.again()
        case "halt":
            blocks.add(End(halts=True))
        case _:
            if blocks.depth:
                blocks.close()
            elif len(reader.open) > 1:
                _end_routine(reader)
            else:
                _misread(reader, event.start())
    return ""


def _end_routine(reader: _UrReader) -> None:
    name, blocks = reader.open.pop()
    if reader.defined[name] > 1:  # The name is ambiguous, so calls of it are uncertain.
        why = Unknown(0, 0, f"{name} is defined twice")
        reader.routines[f"{name} {len(reader.routines)}"] = (ForgetAll(why), *blocks.finish_routine())
    else:
        reader.routines[name] = blocks.finish_routine()


def _misread(reader: _UrReader, place: int, fault: str = "the blocks end in the wrong place") -> None:
    """Treat the complete state as unknown, because the text cannot be parsed."""
    reader.beside.append(Call("\0", reader.why(place, fault)))


def _call(reader: _UrReader, event: re.Match[str]) -> None:
    """Parse a call of a routine of the script, of a move, or of any other function."""
    name, at, blocks = event["call"], event.start(), reader.blocks
    end = reader.closes.get(event.end() - 1)
    if name in reader.defined:
        before = reader.text[reader.text.rfind("\n", 0, at) + 1 : at]
        called = _site(reader, name, at, arguments(reader.text, event.end(), end)) if end else name
        blocks.evaluated(before, Call(called, reader.why(at, f"{name} is called")))
    elif name in _WAYS:
        if end is None:
            _leave(reader, at, "computed", name)
        else:
            _move(reader, name, at, arguments(reader.text, event.end(), end))
    elif name == "set_tcp":
        blocks.add(Set("tool", _tool(reader, at, event.end() - 1)))
    elif name in _SWITCHES:
        blocks.add(Set(*_SWITCHES[name]), Elsewhere())
    elif name in _ELSEWHERE:
        blocks.add(Elsewhere())
    elif name not in _NOTHING:
        blocks.add(ForgetAll(reader.why(at, f"{name} is unknown here")))
        for place in arguments(reader.text, event.end(), end) if end else ():
            if _list(reader.text, *place):
                reader.literals.add(place[0])
                reader.points.leave(reader.uncorrected_target(place[0], "handed", reader.text[slice(*place)]))


def _site(reader: _UrReader, name: str, at: int, places: list[tuple[int, int]]) -> str:
    """Return the name of a call of an own routine. A call with points has its own name."""
    routine = next(one for one in reader.all_routines if one.name == name)
    found: dict[str, Argument] = {}
    for k, (begin, end) in enumerate(places):
        named = re.compile(r"([A-Za-z_]\w*)\s*=\s*(?!=)").match(reader.text, begin, end)
        parameter = named[1] if named else routine.parameters[k] if k < len(routine.parameters) else ""
        start = named.end() if named else begin
        text = reader.text[start:end]
        key = f"\2{name} at {start}" if _list(reader.text, start, end) else reader.parameter(text, start)
        key = key or (text if reader.points.knows(text) else "")
        if key and parameter in routine.parameters and routine.kind == "def" and reader.defined[name] == 1:
            found[parameter] = Argument(key, start)
        elif key.startswith("\2"):
            reader.points.leave(reader.uncorrected_target(start, "handed", text))
    if not found:
        return name
    reader.sites[f"\1{name} at {at}"] = CallSite(routine, found)
    return f"\1{name} at {at}"


def _move(reader: _UrReader, name: str, at: int, places: list[tuple[int, int]]) -> None:
    """Parse a move with its arguments."""
    named = [place for place in places if _TARGET.match(reader.text, *place)]
    named.sort(key=lambda place: not reader.text.startswith("pose_via", place[0]))  # The via point is passed first.
    count = 2 if name == "movec" and len(places) > 1 else 1
    is_arc = name == "movec" and count > 1
    arc, tangent = (f"arc at {at}", _is_tangent(reader, places)) if is_arc else ("", False)
    for k, place in enumerate(named or places[:count]):
        _target(reader, name, *place, arc=(arc, tangent, k == 0))
    if name in _STREAMED:
        reader.blocks.add(Elsewhere())


def _is_tangent(reader: _UrReader, places: list[tuple[int, int]]) -> bool:
    """Return whether a movec with these arguments keeps the orientation fixed to the tangent: mode 1.

    A computed mode counts as mode 1.
    """
    texts = [reader.text[slice(*place)] for place in places]
    named = [mode[1] for text in texts if (mode := _MODE.fullmatch(text))]
    number = named[0] if named else texts[_MODE_PLACE] if len(texts) > _MODE_PLACE else "0"
    return not re.fullmatch(NUMBER, number) or float(number) != 0


def _leave(reader: _UrReader, place: int, reason: Reason, name: str) -> None:
    reader.points.leave(reader.uncorrected_target(place, reason, name))
    reader.blocks.add(Elsewhere())


def _tool(reader: _UrReader, at: int, opening: int) -> Value:
    """Return the tool of a set_tcp with the bracket at `opening`, or unknown."""
    unknown = reader.why(at, "set_tcp sets a computed tool")
    end = reader.closes.get(opening, 0)
    if not opening < end < opening + _LONGEST:
        return unknown
    begin, stop = arguments(reader.text, opening + 1, end)[0]
    if named := re.compile(r"pose\s*=\s*").match(reader.text, begin, stop):
        begin = named.end()
    name = reader.text[begin:stop]
    literal = _list(reader.text, begin, stop)
    values = tuple(number.value for number in literal[1]) if literal and literal[0] else reader.poses.get(name)
    if values is None or not np.isfinite(values).all():
        return unknown
    if literal:
        reader.literals.add(begin)
    else:
        reader.spent.add(begin)
        reader.tools[name] = begin
        reader.points.silent.add(name)
    value = as_value(frame_of("rotation_vector", values))
    reader.points.state(NamedFrame("tcp", "tool", 0, reader.lines.at(at), value))
    return value


def _list(text: str, begin: int, end: int) -> tuple[str, tuple[Number, ...]] | None:
    """Return "p" or "" and the six numbers of a literal; None for any other text."""
    literal = re.compile(r"(p?)\[([^\[\]]*)\]").fullmatch(text, begin, end)
    numbers = numbers_in(text, literal.start(2), literal.end(2)) if literal else None
    return (literal[1], numbers) if literal and numbers and len(numbers) == 6 else None


def _target(
    reader: _UrReader,
    call: str,
    begin: int,
    end: int,
    near: tuple[float, ...] | None = None,
    *,
    solved: bool = False,
    arc: tuple[str, bool, bool] = ("", False, False),
) -> None:
    """Parse a target of a move.

    solved: the target is inside get_inverse_kin, with the joint angles `near` (6,) rad. arc: name of the arc,
    whether it rotates the tool with the tangent, and whether the target is the via point.
    """
    text, line = reader.text, reader.lines.at(begin)
    if named := _TARGET.match(text, begin, end):
        begin = named.end()
    if not solved and (inverse := _INVERSE.match(text, begin, end)) and "get_inverse_kin" not in reader.defined:
        if arc[1]:
            _leave(reader, begin, "arc_turns", text[begin:end])
        else:
            _inverse(reader, call, inverse.end(), reader.closes.get(inverse.end() - 1))
        return
    name, way = text[begin:end], _WAYS[call]
    pose = _derived(reader, begin, end)
    key = _point(reader, call, *((pose.begin, pose.end) if pose else (begin, end)))
    if not key or (pose and pose.offset and not key.startswith("\1") and reader.points.joints(key)):
        _leave(reader, begin, "not_literal" if _WORD.fullmatch(name) else "computed", name)
        return
    near = near if way == "joint" else None
    by_angles = way == "joint" and (near is not None or (not key.startswith("\1") and reader.points.joints(key)))
    move = Move(
        key, way, 0, line, Ref("tool"), needs=("shift", "tracking"), trusts=None if by_angles else _KEEPS,
        near=near, arc=arc[0], tangent=arc[1], through=arc[2],
    )  # fmt: skip
    if pose and pose.offset:
        move = replace(move, key=f"{name} of {key}", base=key, offset=pose.offset)
    elif pose:
        move = replace(move, frame=pose.frame)
    reader.blocks.add(move)


def _derived(reader: _UrReader, begin: int, end: int) -> DerivedPose | None:
    """Return the derived pose of an argument: written there, or in a variable."""
    name = reader.text[begin:end]
    if pose := reader.derived.get(name):
        # A parameter has its value only while its routine runs.
        of = reader.parameter(reader.text[pose.begin : pose.end], pose.begin)
        if of and reader.routine_at(begin) != reader.routine_at(pose.begin):
            return None
        reader.spent.add(begin)
    elif reader.expressions and not _WORD.fullmatch(name):
        pose = reader.expressions.derived(begin, end, reader.why(begin, "the offset is computed"))
    if pose:
        reader.spent.update(pose.sources)
        reader.literals.update(pose.literals)
        for source in pose.sources:
            word = _WORD.match(reader.text, source)
            if word and word[0] != reader.text[pose.begin : pose.end]:  # The numbers of a frame or an offset
                reader.points.silent.add(word[0])
                reader.tools[word[0]] = source
    return pose


def _point(reader: _UrReader, call: str, begin: int, end: int) -> str:
    """Return the key of the point of a move: numbers in place, a variable or a parameter; empty for other text."""
    name = reader.text[begin:end]
    if literal := _list(reader.text, begin, end):
        key = f"at {begin}"
        if begin not in reader.literals:
            reader.literals.add(begin)
            form: Form = "rotation_vector" if literal[0] else "joints_rad"
            reader.points.declare(key, Target(call, 0, reader.lines.at(begin), form, literal[1], "tcp", "base"))
        return key
    if key := reader.parameter(name, begin):
        reader.spent.add(begin)
        return key
    if not reader.points.knows(name):
        return ""
    reader.spent.add(begin)
    reader.reached.add(name)
    return name


def _inverse(reader: _UrReader, call: str, begin: int, end: int | None) -> None:
    """Parse get_inverse_kin(pose, qnear): a pose, with joint angles near the solution."""
    places = arguments(reader.text, begin, end) if end else []
    near = None
    if len(places) > 1:
        start, stop = places[1]
        if named := re.compile(r"q_?near\s*=\s*").match(reader.text, start, stop):
            start = named.end()
        literal = _list(reader.text, start, stop)
        near = tuple(number.value for number in literal[1]) if literal else reader.joints.get(reader.text[start:stop])
        if near is not None and not literal:
            reader.spent.add(start)
    if not places or (len(places) > 1 and near is None) or len(places) > 2:
        _leave(reader, begin, "computed", call)
        return
    _target(reader, call, *places[0], near, solved=True)


READER = ProgramReader(parse, _DECIMALS, Remark("# "), null_frames=("base",))
