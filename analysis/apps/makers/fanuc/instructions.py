"""What the instructions and motion options of FANUC's teach pendant language can change.

Sources: FANUC, R-30iB Operator's Manuals, Basic Operation B-83284EN, chapter 4, Arc Welding Function B-83284EN-3, Spot
Welding Function B-83284EN-4, and public listings. An instruction with no row may change anything: a macro, for example,
runs a program that its name does not state.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from analysis.apps.makers.program_machine import OFF

INSIDE = r"\[(?:[^\[\]]|\[[^\[\]]*\])*\]"


@dataclass(frozen=True)
class Change:
    """What the instructions of a row can change.

    instructions: patterns of the complete texts, separated by bars. sets: parts of the state with their values.
    registers: True if position registers may be written.
    """

    instructions: str
    sets: tuple[tuple[str, str], ...] = ()
    registers: bool = False

    def __post_init__(self) -> None:
        re.compile(self.instructions)


INSTRUCTIONS = (
    Change(
        rf"(?:P|AR|R|SR|F|M|DO|DI|RO|RI|GO|GI|AO|AI|SO|SI|UO|UI|WO|WI|TIMER|VR|STR|PL){INSIDE}\s*(?:,\s*\S+\s*)?=.*"
    ),
    # Waiting, speed, payload, messages and monitoring
    Change(r"(?:PAUSE|WAIT\b(?!.*TIMEOUT)|OVERRIDE\s*=|PAYLOAD\s*\[|JOINT_MAX_SPEED|LINEAR_MAX_SPEED|TORQ_LIMIT\b).*"),
    Change(r"(?:UALM\[|MESSAGE\[|REMARK\b|--|RSR\[|STRLEN\b|FINDSTR\b|SUBSTR\b|DIAG_|SEMAPHORE\[).*|CLEAR_RESUME_PROG"),
    Change(r"(?:SKIP\s+CONDITION|COL\s+(?:DETECT|GUARD)|FOLLOW\s+UP|(?:UN)?LOCK\s+(?:PREG|VREG)|MONITOR\s+END)\b.*"),
    Change(r"U(?:FRAME|TOOL)_NUM\[\s*GP[2-9][^\]]*\]\s*=.*"),
    # Logic along a move (P-SPS) waits for a condition.
    Change(r"TC_ONLINE\b.*"),
    # Welding, weaving, spot welding and dispensing act at the tool.
    Change(r"(?:Arc|Weld|Wire)\s+(?:Start|End|Stick|Inch|Retract)\b.*|Weave\b.*|WELD_SPEED\s*=.*"),
    Change(r"(?:SPOT|PRESS_MOTN|TIPDRESS|TIPWEAR|STROKE|GUN_EQUALIZE)\s*\[.*|BACKUP\s*=.*|(?:SS|SE)\[.*"),
    # Cameras and conveyors: the results are in vision registers. A tracking program has a header of its own.
    Change(r"VISION\s+(?:RUN_FIND|GET_OFFSET|GET_PASSFAIL|GET_NFOUND|CAMERA_CALIB|SET_REFERENCE|OVERRIDE)\b.*"),
    Change(r"(?:LINECOUNT\[|LINESIM\[|LINE\[|SETTRIG\b|DEFENC\b|SETBOUND\b|SELBOUND\b|STOP_TRACKING).*"),
    # Palletising: counters and the stack; the moves themselves are computed.
    Change(r"PALLETIZING(?:-END)?\w*.*"),
    # System variables of applications, messages, timers and overrides; frames, limits and selections have no row.
    Change(
        r"\$(?:WAITTMOUT|MCR\.\$GENOVERRIDE|SCR\.\$\w+|PRGOVERRIDE|TIMER\[[^\]]*\]\S*|(?:SPOT|SG|SV?GUN|AW|WV|SEAL|DISP|"
        r"UALRM|ALM|MSG|HOST|TX|KAREL_ENB|VW)\w*\S*)\s*=.*"
    ),
    # Seam tracking, soft servo and touch sensing move the path.
    Change(r"(?:SOFTFLOAT|Track)\s+End.*", (("tracking", OFF),)),
    Change(r"(?:SOFTFLOAT|Track)\b.*", (("tracking", "on"),)),
    Change(r"(?:Touch\s+Offset|MP\s+OFFSET)\s+End.*|MP\s+END.*", (("shift", OFF),)),
    Change(r"(?:Touch\s+Offset|MP\s+OFFSET)\b.*", (("shift", "on"),)),
    Change(r"Search\s+(?:Start|End)\b.*", (), registers=True),
)
"""Changes by instructions that neither move the arm nor select or run a program. The first matching row is valid.

Assignments to position registers, frames and their numbers, flow control and calls are read by their contents.
"""
_COMPILED = tuple((re.compile(row.instructions, re.IGNORECASE), row) for row in INSTRUCTIONS)


def change_by(text: str) -> Change | None:
    """Return what an instruction can change, None if it has no row."""
    return next((row for pattern, row in _COMPILED if pattern.fullmatch(text)), None)


_SPEED = r"(?:\d+(?:\.\d*)?|\.\d+|A?R\[[^\]]*\])\s*(?:%|mm/sec|cm/min|inch/min|deg/sec|sec|msec)|max_speed|WELD_SPEED"
OPTIONS = re.compile(
    rf"(?:{_SPEED}|FINE|CNT\s*(?:\d+|A?R\[[^\]]*\])|CD\s*\d+|CR\s*\d+|ACC\s*(?:\d+|A?R\[[^\]]*\])|DEC\s*\d+|Wjnt|PTH|MROT|"
    r"MINROT|BREAK|PSPD\s*\d+|(?:AP|RT)_LDR?\s*(?:\d+|\[[^\]]*\]|R\[[^\]]*\])|CTV\s*-?\d+|EV\s*\d+\s*%|Ind\.EV\s*\d+\s*%|"
    rf"RampTo\s+A?R\[[^\]]*\]|(?:Arc|Weld)\s+(?:Start|End)\s*{INSIDE}|(?:SPOT|PRESS_MOTN)\s*{INSIDE}|[;\s])",
    re.IGNORECASE,
)
"""Options after a target that change neither the position nor the motion to it."""
