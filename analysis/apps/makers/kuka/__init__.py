"""KUKA controllers: the KRL language, and the machine data.

An axis reads $MAMES at the mastering notch. A larger reading therefore requires $MAMES to grow by the same angle.
"""

from analysis.apps.makers import ConstantParameter, Controller, ProgramFiles

FILES = ProgramFiles("KUKA", (".src",), data=".dat")
CONTROLLER = Controller(
    "KUKA",
    "the machine data ($machine.dat)",
    "$MAMES[{axis}]",
    "deg",
    1.0,
    "",
    (
        "Change the machine data, then master the axis at the notch: the reading there becomes $MAMES.",
        "Machine data must be changed only by trained personnel; keep a copy of the file.",
    ),
    "KUKA KR C2 operating handbook, machine data 2.1.7 and 2.1.156 to 2.1.161: "
    "manualshive.com/en/manual/kuka/kr-c2/2009633, pages 12, 76 and 77",
    "the components of $TX3P3 and $TFLWP that contain a length, the signs of $DH_4 and $DH_5, and whether "
    "a newer controller keeps changed machine data are not published; the model of an absolutely accurate "
    "robot (PID file) is closed, and if $ABS_ACCUR is active, these values do not describe the arm: use "
    "corrected targets",
    constants=(
        ConstantParameter("a_mm", "$LENGTH_A", "mm", 1.0, axes=(2,), by_size=True),
        ConstantParameter("a_mm", "$LENGTH_B", "mm", 1.0, axes=(3,), by_size=True),
        ConstantParameter("a_mm", "height in $TX3P3", "mm", 1.0, axes=(4,), by_size=True),
        ConstantParameter("d_mm", "length in $TX3P3", "mm", 1.0, axes=(4,), by_size=True),
        ConstantParameter("d_mm", "length in $TFLWP", "mm", 1.0, axes=(6,), by_size=True),
    ),
)
