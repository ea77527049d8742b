"""Closed lists of KRL: what each statement, variable and routine of the maker can change.

Source: KUKA System Software 8.x, Operating and Programming Instructions for System Integrators; KUKA System Software,
CREAD/CWRITE; KUKA.Ethernet KRL; inline forms of KUKA.ArcTech, Gripper&SpotTech and TouchSense in public programs.
"""

from __future__ import annotations

import re
from typing import Literal

from analysis.apps.makers.program_parser import word_set

NOTHING = re.compile(
    r"\s*(?:INTERRUPT\s+(?:ON|OFF|ENABLE|DISABLE)|WAIT|HALT|BRAKE|CONTINUE|PULSE|ANOUT|ANIN|CWRITE|CREAD|COPEN|CCLOSE|"
    r"SREAD|SWRITE|SPLINE|ENDSPLINE|PTP_SPLINE|ON_ERROR_PROCEED)\b.*"
)
"""Statements that change neither tool, base nor arm, except through function calls. BRAKE only interrupts a motion."""
SYSTEM = re.compile(
    r"\$(?:VEL|ACC|APO|VEL_AXIS|ACC_AXIS|VEL_EXTAX|ACC_EXTAX|OV_PRO|OV_APPL|ADVANCE|OUT|ANOUT|FLAG|CYCFLAG|TIMER|"
    r"TIMER_STOP|TIMER_FLAG|CIRC_TYPE|CIRC_MODE|SPL_ORI_JOINT_AUTO|BWDSTART|H_POS|LOAD|LOAD_A1|LOAD_A2|LOAD_A3|"
    r"ACT_TOOL|ACT_BASE|OUT_C|GEAR_JERK|JERK|APO_DIS_PTP|MSG_T|SEN_PINT|SEN_PREA|SINT_LIST|CYCLE|TORQUE_AXIS|"
    r"COLLMON_TOL_PRO|TORQMON|TORQMON_COM|REDVEL|RED_VEL|VEL_AXIS_MA|LOOP_CONT|LOOP_MSG|OUTPUT|FILTER|ECO_LEVEL|"
    r"OVERRIDE|ANIN|DIGIN\w*|SOFTPLCBOOL|SOFTPLCINT|SOFTPLCREAL|WORKSPACE|AXWORKSPACE|WBOXDISABLE|ERR)"
)
"""System variables that change neither tool, base nor the target of a move."""
CORRECTIONS = re.compile(r"(?:TOOL|BASE)_CORR(?:_ON)?")
"""Variables of bas.src that displace the tool and base of inline forms."""

Effect = Literal["nothing", "arguments", "arm", "base"]
_ROUTINES: dict[Effect, str] = {
    "nothing": """
        SIN COS TAN ACOS ASIN ATAN ATAN2 SQRT ABS ROUND EXP LOG MIN MAX INV_POS INVFRAME
        STRCOMP STRDECLLEN STRFIND STRLEN VARSTATE GETVARSIZE VARTYPE
        EXISTS_KRLMSG EXISTS_KRLDLG SET_KRLMSG SET_KRLDLG CLEAR_KRLMSG
        MSGNOTIFY MSGQUIT MSGSTATE MSGEVENT MSGLOOP MSGWAIT MSGTEST KRLMSG
        NOT AND OR EXOR B_AND B_OR B_NOT B_EXOR IF ELSEIF WHILE UNTIL SWITCH CASE FOR TO STEP THEN WAIT SEC RETURN
        SVEL_CP SVEL_PTP SVEL_JOINT SACC_CP SACC_PTP SACC_JOINT SGEAR_JERK SAPO SAPO_PTP SORI_TYP SLOAD STOOL
        STOOL2 SBASE SIPO_MODE SJERK SET_CD_PARAMS USE_CM_PRO_VALUES PULSE
        EKI_INIT EKI_OPEN EKI_CLOSE EKI_CLEAR EKI_SEND EKI_CHECKBUFFER
        EKI_SETBOOL EKI_SETINT EKI_SETREAL EKI_SETSTRING EKI_SETFRAME
        BAS IR_STOPM P00 CHECK_HOME H50 GRP_STATE GRPG_SETSTATE GRPG_SETSTATEANDCHECK GRPG_CHECK USER_GRP USERSPOT
        A10 A10_INI A20 ARCMAINNG ARCGETDELAY ARCGETPATH
        """,
    "arguments": """
        INVERSE FORWARD STRADD STRCLEAR STRCOPY STRDELIM STRTOINT STRTOREAL STRTOBOOL STRTOSTRING
        STRTOSTRUCT STRTOFRAME STRTOPOS STRTOE3POS STRTOE6POS STRTOAXIS STRTOE3AXIS STRTOE6AXIS CAST_FROM CAST_TO
        CIOCTL GET_MSGBUFFER MSGDIALOG GET_SYSTEM_DATA EKI_GETBOOL EKI_GETINT EKI_GETREAL EKI_GETSTRING EKI_GETFRAME
        CREAD SREAD SWRITE COPEN CCLOSE
        """,
    "arm": "MASREF_MAIN BRAKETESTREQ BRAKETESTSTART",
    "base": "H70",
}
"""Routines of the maker by what they can change: nothing; only their arguments; the position of the arm; or the
position and, by the correction of a search, the base. H50 and GRP… are grippers, A10, A20 and ARC… arc welding,
USERSPOT a spot gun, H70 TouchSense. Any other routine without a text can change everything."""
_EFFECTS: dict[str, Effect] = {name: effect for effect, names in _ROUTINES.items() for name in word_set(names)}
_WITHOUT_SEARCH = word_set("1 6 7 8")
"""First arguments of H70 that only prepare and record a search, as in the INI fold of the pendant."""
_USER_EDITED = word_set("USER_GRP USERSPOT")
"""Routines that the user may edit: their text counts, if it is available."""
_FOLDERS = word_set("SYSTEM TP MADA STEU")
_MODULES = word_set("BAS IR_STOPM P00 H50 H70 A10 A20 ARC_MAIN MSGLIB")
_OPENED = re.compile(r"\bCOPEN\s*\([^,()]*,\s*(\w+)\s*\)")


def effect_of(name: str, arguments: str, texts: tuple[str, ...] = ()) -> Effect | None:
    """What a routine of the maker can change; None if it can change everything or is unknown.

    CWRITE to the channel $CMD executes commands. A handle that the texts open and never assign is certainly another.
    """
    first = arguments.split(",", maxsplit=1)[0].strip()
    if name == "CWRITE":
        opened = any(handle == first for text in texts for handle in _OPENED.findall(text))
        assigned = any(re.search(rf"(?<![\w$.]){re.escape(first)}\s*=(?!=)", text) for text in texts)
        return "arguments" if opened and not assigned else None
    return "nothing" if name == "H70" and first in _WITHOUT_SEARCH else _EFFECTS.get(name)


def is_file_of_maker(name: str) -> bool:
    """True for a file of the maker, by its path in a backup, and for copies of its modules in other directories."""
    *folders, file = name.upper().split("/")
    return any(folder in _FOLDERS for folder in folders) or file[:1] == "$" or file.partition(".")[0] in _MODULES


def is_of_maker(name: str) -> bool:
    """True if the table describes a routine, so that its text is not needed."""
    return name in _EFFECTS and name not in _USER_EDITED
