"""LinuxCNC: G-code, the pins of genserkins and HOME_OFFSET.

genserkins computes with Craig's constants, as the rig file does, but has no offset of a joint: the reading of a joint
is its angle theta. Joints and pins count from 0. Lengths are in the unit of the machine.
"""

import math

from analysis.apps.makers import ConstantParameter, Controller, ProgramFiles
from analysis.apps.makers.linuxcnc.values import value_files

FILES = ProgramFiles("LinuxCNC", (".ngc", ".nc"))
CONTROLLER = Controller(
    "LinuxCNC",
    "the HAL and INI files",
    "HOME_OFFSET of [JOINT_{axis}]",
    "deg",
    1.0,
    "",
    (
        "Copy rig-arm.hal next to the INI file, and add HALFILE = rig-arm.hal to [HAL] after the file that sets the "
        "pins until now.",
        "Write the lines of home-offsets.ini into the sections [JOINT_0] … [JOINT_5] of the INI file.",
        "Restart LinuxCNC, and home all joints.",
    ),
    "manual page kins(9) and INI configuration (HOME_OFFSET), LinuxCNC 2.9; entered in linuxcnc-uspace 2.9.0 "
    "(docs/evidence/linuxcnc.md)",
    "beta and the offset of an axis have no pin; the values refer to pins as in the rig file: rig init --arm FILE.ini "
    "reads them",
    constants=(
        ConstantParameter("a_mm", "genserkins.A-{axis}", "mm", 1.0, 1),
        ConstantParameter("alpha_deg", "genserkins.ALPHA-{axis}", "rad", math.radians(1), 1),
        ConstantParameter("d_mm", "genserkins.D-{axis}", "mm", 1.0, 1),
    ),
    first_joint=0,
    signs_tested=True,
    files=value_files,
)
