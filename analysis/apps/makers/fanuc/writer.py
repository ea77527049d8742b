"""Writer of FANUC's teach pendant language (.LS) for the motion, and of KAREL for the feedback.

Sources: FANUC, R-30iB Operator's Manual (Basic Operation) B-83284EN, chapter 4, public backups in .LS, and R-30iB
KAREL Reference Manual B-83144EN. Joint moves have joint positions, so the posture is unambiguous; lines and arcs need
micrometres, so they have Cartesian ones.

The KAREL program prints the joint angles as lines for `line_feed`. It needs the option of user socket messaging, and a
server tag S3 in the host communication set-up of the controller.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from analysis.apps.makers.configuration import configuration_of, turns
from analysis.apps.makers.motion_plan import (
    Arc,
    Demand,
    JointMove,
    MotionPlan,
    Move,
    PlannedTarget,
    StraightMove,
    ToolRotation,
    percent_of_axes,
    start_of,
)
from analysis.apps.makers.program_text import (
    DEG_DECIMALS,
    MM_DECIMALS,
    Words,
    fixed,
    fixed_xyz_deg,
    heading,
    identifier,
    labelled,
    shown_pose,
)
from analysis.apps.makers.program_writer import BY_ITSELF, ProgramWriter
from analysis.robot.kinematics.arm import Arm
from rigs.errors import FileError
from rigs.schema.condition import CONDITION
from rigs.schema.feedback import SIGNAL, FANUCStreamMotion, LineFeed
from rigs.schema.links import tcp_address

_PERIOD_MS = 8
"""Interpolation time of R-30iB controllers. With a shorter pause the same angles would be printed twice."""
_CLOCK = {"t_s": "clock / 1000.0::12::3", "t_ms": "clock::12", "t_us": "clock::12, '000'"}
_RAD_PER_DEG = "0.017453293"
_PROGRAM = """\
PROGRAM rigfeed
-- prints the joint angles to the computer that connects to tag S3; moves nothing
%NOLOCKGROUP
%NOPAUSE = ERROR + COMMAND + TPENABLE
VAR
  client : FILE
  stands : JOINTPOS
  joints : ARRAY[9] OF REAL
  clock, entry, signal, status : INTEGER
BEGIN
  clock = 0
  CONNECT TIMER TO clock
  SET_FILE_ATR(client, ATR_IA)
  SET_VAR(entry, '*SYSTEM*', '$HOSTS_CFG[3].$SERVER_PORT', {port}, status)
  WHILE TRUE DO
    MSG_DISCO('S3:', status)
    MSG_CONNECT('S3:', status)
    IF status = 0 THEN
      OPEN FILE client ('RW', 'S3:')
      status = IO_STATUS(client)
      WHILE status = 0 DO
        stands = CURJPOS(0, 0)
        CNV_JPOS_REL(stands, joints, status)
{signal}        WRITE client ({line}, CHR(13), CHR(10))
        status = IO_STATUS(client)
        DELAY {period}
      ENDWHILE
      CLOSE FILE client
    ELSE
      DELAY 1000
    ENDIF
  ENDWHILE
END rigfeed
"""


def feed(plan: MotionPlan) -> dict[str, str]:
    """Write the KAREL program for a rig that reads lines over TCP as the client; an empty dictionary otherwise."""
    feedback = plan.feedback
    if not isinstance(feedback, LineFeed) or feedback.listens or (address := tcp_address(feedback.port)) is None:
        return {}
    separator = feedback.separator
    if not separator.isascii():
        raise FileError(
            "feedback",
            f"KAREL cannot print the separator {separator!r}",
            "choose one in ASCII",
            code="rig_file.invalid",
        )
    # Characters that cannot be quoted are written as numbers.
    parts = [char if char.isprintable() and char != "'" else f"', CHR({ord(char)}), '" for char in separator]
    literal = f"'{''.join(parts)}'".removeprefix("'', ").removesuffix(", ''")
    line = f", {literal}, ".join(map(_field, feedback.fields))
    numbered = []
    # The number shown by the outputs; the first output is the least significant bit.
    if SIGNAL in feedback.fields:
        numbered = ["signal = 0"]
        for bit, number in enumerate(plan.signal_place.outputs):
            numbered += [f"IF DOUT[{number}] THEN", f"  signal = signal + {1 << bit}", "ENDIF"]
    signal = "".join(f"        {line_of_signal}\n" for line_of_signal in numbered)
    text = _PROGRAM.format(port=address[1], line=line, signal=signal, period=_PERIOD_MS)
    return {"RIGFEED.KL": text}


def _field(name: str) -> str:
    if name in _CLOCK:
        return _CLOCK[name]
    if name == SIGNAL:
        return "signal::6"
    if name == "_":
        return "'0'"
    if name in CONDITION:
        raise FileError(
            "feedback",
            f"the generated program cannot print {name}",
            "remove the field from `fields`",
            code="rig_file.invalid",
        )
    joint = f"joints[{name[1]}]"
    return f"{joint}::12::4" if name.endswith("_deg") else f"{joint} * {_RAD_PER_DEG}::12::7"


_NAME_LENGTH = 36
_WORDS = Words("  WAIT {}(sec)", 2, "  DO[{}]=ON", "  DO[{}]=OFF", "  !{}", 32, "  PAUSE")
TOOL_NUMBER = 9
"""The last tool frame that every controller has."""
_REGISTER = 99
"""The last of the 100 position registers of a controller. UTOOL is set from a register."""


def write(plan: MotionPlan, demand: Demand) -> dict[str, str]:
    name = identifier(plan.name, _NAME_LENGTH).upper()
    positions: dict[str, int] = {}
    remarks = _WORDS.remarks(*heading(plan, demand, f"(world) {shown_pose(start_of(plan).T, 'WPR')}"))
    moves = [line for step in plan.steps for line in _WORDS.lines(plan, step, partial(_move, plan.arm, positions))]
    # The world frame, and the frame of the tool from the rig file, set through a position register
    values = [*plan.arm.T_flange_tool[:3, 3], *fixed_xyz_deg(plan.arm.T_flange_tool)]
    texts = [f"({text})" if text.startswith("-") else text for text in (fixed(value, 6) for value in values)]
    elements = [f"  PR[{_REGISTER},{place}]={text}" for place, text in enumerate(texts, start=1)]
    set_tool = [f"  UTOOL[{TOOL_NUMBER}]=PR[{_REGISTER}]", f"  UTOOL_NUM={TOOL_NUMBER}"]
    frames = ["  UFRAME_NUM=0", f"  PR[{_REGISTER}]=LPOS", *elements, *set_tool]
    numbered = []
    for number, instruction in enumerate([*remarks, *frames, *moves], start=1):
        first, *continued = instruction.split("\n")  # The second line of an arc has no number.
        numbered.append("\n".join([f"{number:4d}:{first}", *(f"    :{text}" for text in continued)]) + " ;")
    points = [f"P[{number}]{{\n   GP1:\n{text}\n}};" for text, number in positions.items()]
    head = [f"/PROG  {name}", "/ATTR", 'COMMENT\t\t= "RIG PROGRAM";', "DEFAULT_GROUP\t= 1,*,*,*,*;", "/MN"]
    return {f"{name}.LS": "\n".join([*head, *numbered, "/POS", *points, "/END", ""]), **feed(plan)}


def _move(arm: Arm, positions: dict[str, int], step: Move) -> list[str]:
    match step:
        case JointMove(target, speed_rad_s):
            angles = labelled("J{}= {} deg", "123456", np.degrees(target.q), DEG_DECIMALS)
            number = _number(f"\tUF : 0, UT : {TOOL_NUMBER},\n{_two_rows(angles)}", positions)
            return [f"J P[{number}] {percent_of_axes(arm, speed_rad_s)}% FINE"]
        case StraightMove(target, speed_mm_s, stops):
            number = _number(_cartesian(arm, target), positions)
            return [f"L P[{number}] {_plain(speed_mm_s)}mm/sec {'FINE' if stops else 'CNT0'}"]
        case ToolRotation(target, _, speed_rad_s):
            number = _number(_cartesian(arm, target), positions)
            return [f"L P[{number}] {_plain(np.degrees(speed_rad_s))}deg/sec FINE"]
        case Arc(via, end, speed_mm_s, stops):
            middle, last = (_number(_cartesian(arm, target), positions) for target in (via, end))
            return [f"C P[{middle}]\n  P[{last}] {_plain(speed_mm_s)}mm/sec {'FINE' if stops else 'CNT100'}"]


def _number(text: str, positions: dict[str, int]) -> int:
    return positions.setdefault(text, len(positions) + 1)


def _plain(value: float) -> str:
    return fixed(value, 1).removesuffix(".0")


def _cartesian(arm: Arm, target: PlannedTarget) -> str:
    flip, up, front = configuration_of(arm, target.q)
    counts = ", ".join(str(turns(float(angle))) for angle in target.q[3:])
    letters = f"{'NF'[flip]} {'DU'[up]} {'BT'[front]}"
    places = labelled("{} = {} mm", "XYZ", target.T[:3, 3], MM_DECIMALS)
    angles = labelled("{} = {} deg", "WPR", fixed_xyz_deg(target.T), DEG_DECIMALS)
    return f"\tUF : 0, UT : {TOOL_NUMBER},\t\tCONFIG : '{letters}, {counts}',\n{_two_rows(places + angles)}"


def _two_rows(six: list[str]) -> str:
    return ",\n".join("\t" + ",\t".join(three) for three in (six[:3], six[3:]))


WRITER = ProgramWriter(
    write,
    {LineFeed: "translate RIGFEED.KL and start it before the program", FANUCStreamMotion: BY_ITSELF},
)
