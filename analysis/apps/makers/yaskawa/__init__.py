"""Yaskawa controllers: the INFORM language, and the home position.

The reading of an axis is (count - count at zero) / counts per degree. A larger reading therefore requires a smaller
count at zero.
"""

from analysis.apps.makers import Controller, ProgramFiles

FILES = ProgramFiles("Yaskawa", (".jbi",))
CONTROLLER = Controller(
    "Yaskawa",
    "the home position (ABSO data)",
    "home position (ABSO data) of axis {axis}",
    "pulses",
    -1.0,
    "pulses per degree",
    ("Change the absolute data of the home position in management mode.",),
    "a service article (W): industrialmonitordirect.com/blogs/knowledgebase/"
    "yaskawa-dx100-home-position-mastering-pulse-recovery-guide",
    "the sign of the pulses and parameters for link constants are not published, so use corrected targets "
    "for the other errors; pulses per degree follow from the gear ratio and encoder in ALL.PRM (W): "
    "industrialmonitordirect.com/blogs/knowledgebase/calculating-pulses-per-degree-on-yaskawa-up130-robot-axes",
)
