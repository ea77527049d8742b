"""The KAREL program that prints the joint angles of a FANUC robot, one line a sample, as `line_feed` reads them.

Source: FANUC, R-30iB KAREL Reference Manual B-83144EN (CURJPOS, CNV_JPOS_REL, MSG_CONNECT, CONNECT TIMER, formats of
WRITE; lines end with CHR(13) and CHR(10), since what CR sends depends on the port). It needs the option of user socket
messaging and a server tag S3 in the controller's host communication set-up. It moves nothing.
"""

from __future__ import annotations

from analysis.robot_programs.plan import Plan, SignalPlace
from rigs.errors import FileError
from rigs.schema.feedback import SIGNAL, LineFeed
from rigs.schema.links import tcp_address

_PERIOD_MS = 8
"""Interpolation time of R-30iB controllers; after a shorter pause the same angles would be printed twice."""
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


def feed(plan: Plan) -> dict[str, str]:
    """The program for a rig that calls it and reads lines over TCP; nothing for others."""
    if not isinstance(plan.feedback, LineFeed) or plan.feedback.listens:
        return {}
    if (address := tcp_address(plan.feedback.port)) is None:
        return {}
    line = f", {_literal(plan.feedback.separator)}, ".join(map(_field, plan.feedback.fields))
    signal = _signal(plan.signal_place) if SIGNAL in plan.feedback.fields else ""
    text = _PROGRAM.format(port=address[1], line=line, signal=signal, period=_PERIOD_MS)
    return {"RIGFEED.KL": text}


def _literal(separator: str) -> str:
    """A text of KAREL: what cannot stand between quotes by its number. Raises FileError for what is not ASCII."""
    if not separator.isascii():
        raise FileError("feedback", f"KAREL cannot print the separator {separator!r}", "choose one in ASCII")
    parts = [char if char.isprintable() and char != "'" else f"', CHR({ord(char)}), '" for char in separator]
    return f"'{''.join(parts)}'".removeprefix("'', ").removesuffix(", ''")


def _field(name: str) -> str:
    if name in _CLOCK:
        return _CLOCK[name]
    if name == SIGNAL:
        return "signal::6"
    if name == "_":
        return "'0'"
    joint = f"joints[{name[1]}]"
    return f"{joint}::12::4" if name.endswith("_deg") else f"{joint} * {_RAD_PER_DEG}::12::7"


def _signal(place: SignalPlace) -> str:
    """The number that the outputs show, the first output the least."""
    lines = ["signal = 0"]
    for bit, number in enumerate(place.outputs):
        lines += [f"IF DOUT[{number}] THEN", f"  signal = signal + {1 << bit}", "ENDIF"]
    return "".join(f"        {line}\n" for line in lines)
