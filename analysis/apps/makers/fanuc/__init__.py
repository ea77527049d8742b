"""FANUC controllers: listings of teach pendant programs, KAREL for the feedback, and the system variables.

The reading of an axis is (count - count at zero) / counts per degree. A larger reading therefore requires a smaller
count at zero.
"""

from analysis.apps.makers import LATER, ConstantParameter, Controller, ProgramFiles

FILES = ProgramFiles("FANUC", (".ls",), unread=".tp")
CONTROLLER = Controller(
    "FANUC",
    "the system variables",
    "$DMR_GRP[1].$MASTER_COUN[{axis}]",
    "counts",
    -1.0,
    "counts per degree",
    (
        "Change the count, then calibrate (MENU, SYSTEM, Master/Cal).",
        "Set a new quick master reference: the old $REF_POS and $REF_COUNT belong to the old zero.",
        "Note the old lengths; new lengths take effect after a cold start.",
    ),
    "service articles (W): industrialmonitordirect.com/blogs/knowledgebase/"
    "reset-fanuc-extended-axis-master-count-without-continuous-turn, "
    "…/fanuc-robot-dh-parameters-system-variables-reference; a user's report (W) that lengths took effect on an "
    "LR Mate 200iD and angles did not: robot-forum.com/robotforum/thread/23503-modify-fanuc-dh-parameters",
    "counts per degree of the axes, the signs of lengths and a manual of the maker for them were not found in "
    "public, nor how the maker's own calibration option keeps its values: use corrected targets for the other "
    "errors",
    constants=(
        ConstantParameter("a_mm", "$PARAM_GROUP[1].$DH_A[{axis}]", "mm", 1.0, 1, LATER, by_size=True),
        ConstantParameter("d_mm", "$PARAM_GROUP[1].$DH_D[{axis}]", "mm", 1.0, by_size=True),
    ),
)
