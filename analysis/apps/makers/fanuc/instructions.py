"""What the instructions and motion options of FANUC's teach pendant language can change.

Sources: FANUC, R-30iB Operator's Manuals, Basic Operation B-83284EN, chapter 4, Arc Welding Function B-83284EN-3, Spot
Welding Function B-83284EN-4, and public listings. An instruction that is not listed may change anything: a macro runs a
program that its name does not state.
"""

from __future__ import annotations

import re

from analysis.apps.makers.program_machine import OFF

INSIDE = r"\[(?:[^\[\]]|\[[^\[\]]*\])*\]"


def _any_of(*patterns: str) -> re.Pattern[str]:
    return re.compile("|".join(f"(?:{pattern})" for pattern in patterns), re.IGNORECASE)


NOTHING = _any_of(
    rf"(?:P|AR|R|SR|F|M|DO|DI|RO|RI|GO|GI|AO|AI|SO|SI|UO|UI|WO|WI|TIMER|VR|STR|PL){INSIDE}\s*(?:,\s*\S+\s*)?=.*",
    # Waiting, speed, payload, messages and monitoring
    r"(?:PAUSE|WAIT\b(?!.*TIMEOUT)|OVERRIDE\s*=|PAYLOAD\s*\[|JOINT_MAX_SPEED|LINEAR_MAX_SPEED|TORQ_LIMIT\b).*",
    r"(?:UALM\[|MESSAGE\[|REMARK\b|--|RSR\[|STRLEN\b|FINDSTR\b|SUBSTR\b|DIAG_|SEMAPHORE\[).*|CLEAR_RESUME_PROG",
    r"(?:SKIP\s+CONDITION|COL\s+(?:DETECT|GUARD)|FOLLOW\s+UP|(?:UN)?LOCK\s+(?:PREG|VREG)|MONITOR\s+END)\b.*",
    r"U(?:FRAME|TOOL)_NUM\[\s*GP[2-9][^\]]*\]\s*=.*",
    # Logic along a move (P-SPS) waits for a condition.
    r"TC_ONLINE\b.*",
    # Welding, weaving, spot welding and dispensing act at the tool.
    r"(?:Arc|Weld|Wire)\s+(?:Start|End|Stick|Inch|Retract)\b.*|Weave\b.*|WELD_SPEED\s*=.*",
    r"(?:SPOT|PRESS_MOTN|TIPDRESS|TIPWEAR|STROKE|GUN_EQUALIZE)\s*\[.*|BACKUP\s*=.*|(?:SS|SE)\[.*",
    # Cameras and conveyors: the results are in vision registers. A tracking program has a header of its own.
    r"VISION\s+(?:RUN_FIND|GET_OFFSET|GET_PASSFAIL|GET_NFOUND|CAMERA_CALIB|SET_REFERENCE|OVERRIDE)\b.*",
    r"(?:LINECOUNT\[|LINESIM\[|LINE\[|SETTRIG\b|DEFENC\b|SETBOUND\b|SELBOUND\b|STOP_TRACKING).*",
    # Palletising: counters and the stack; the moves themselves are computed.
    r"PALLETIZING(?:-END)?\w*.*",
    # System variables of applications, messages, timers and overrides; frames, limits and selections are not listed.
    r"\$(?:WAITTMOUT|MCR\.\$GENOVERRIDE|SCR\.\$\w+|PRGOVERRIDE|TIMER\[[^\]]*\]\S*|(?:SPOT|SG|SV?GUN|AW|WV|SEAL|DISP|"
    r"UALRM|ALM|MSG|HOST|TX|KAREL_ENB|VW)\w*\S*)\s*=.*",
)
"""Instructions that neither move the arm nor select or run a program."""
SEARCH = re.compile(r"Search\s+(?:Start|End)\b.*", re.IGNORECASE)
"""Touch sensing, which may write position registers."""
_SWITCHES = (
    (re.compile(r"(?:SOFTFLOAT|Track)\b(\s+End)?.*", re.IGNORECASE), "tracking"),
    (re.compile(r"(?:(?:Touch\s+Offset|MP\s+OFFSET)\b|MP(?=\s+END))(\s+End)?.*", re.IGNORECASE), "shift"),
)
"""Seam tracking, soft servo and touch sensing, which move the path until their end."""


def switch_by(text: str) -> tuple[str, str] | None:
    found = ((pattern.fullmatch(text), part) for pattern, part in _SWITCHES)
    return next(((part, OFF if switch[1] else "on") for switch, part in found if switch), None)


_SPEED = r"(?:\d+(?:\.\d*)?|\.\d+|A?R\[[^\]]*\])\s*(?:%|mm/sec|cm/min|inch/min|deg/sec|sec|msec)|max_speed|WELD_SPEED"
OPTIONS = re.compile(
    rf"(?:{_SPEED}|FINE|CNT\s*(?:\d+|A?R\[[^\]]*\])|CD\s*\d+|CR\s*\d+|ACC\s*(?:\d+|A?R\[[^\]]*\])|DEC\s*\d+|Wjnt|PTH|MROT|"
    r"MINROT|BREAK|PSPD\s*\d+|(?:AP|RT)_LDR?\s*(?:\d+|\[[^\]]*\]|R\[[^\]]*\])|CTV\s*-?\d+|EV\s*\d+\s*%|Ind\.EV\s*\d+\s*%|"
    rf"RampTo\s+A?R\[[^\]]*\]|(?:Arc|Weld)\s+(?:Start|End)\s*{INSIDE}|(?:SPOT|PRESS_MOTN)\s*{INSIDE}|[;\s])",
    re.IGNORECASE,
)
"""Options after a target that change neither the position nor the motion to it."""
