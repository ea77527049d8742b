"""ABB controllers: the RAPID language, and the configuration topic Motion.

The reading of an axis is (motor angle - calibration offset) / gear ratio. A larger reading therefore requires a smaller
calibration offset.
"""

import math

from analysis.apps.makers import Controller, ProgramFiles

FILES = ProgramFiles("ABB", (".mod", ".modx", ".prg"), ending="_m")
CONTROLLER = Controller(
    "ABB",
    "the topic Motion (MOC.cfg)",
    "MOTOR_CALIB rob1_{axis} cal_offset",
    "rad",
    -math.radians(1),
    "gear ratio",
    (
        "Change the calibration offset in the topic Motion (MOC.cfg), then restart the controller.",
        "If the new offset exceeds a turn of the motor (± 2π rad), also update the revolution counters.",
    ),
    "a service article (W): industrialmonitordirect.com/blogs/knowledgebase/"
    "abb-irb-6400-axis-3-encoder-drift-after-fine-calibration",
    "the sign of the offset and the gear ratios are not published; a robot with the option Absolute "
    "Accuracy has individual link parameters in MOC.cfg, whose frames are not published (W: "
    "github.com/ros-industrial/abb/discussions/195), so use corrected targets for the other errors",
)
