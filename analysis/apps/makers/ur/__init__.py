"""Universal Robots controllers: the URScript language, and calibration.conf.

The angle of a link is the reading plus delta_theta. A larger angle therefore requires a larger delta_theta, and the
reading does not change. delta_a and delta_alpha are not written: the axes 2 to 4 of a real arm are nearly parallel, so
its delta_d has some 100 m, and a milliradian of delta_alpha would move the tool by 10 cm.
"""

import math

from analysis.apps.makers import ConstantParameter, Controller, ProgramFiles

FILES = ProgramFiles("UR", (".script", ".urscript"), unread=".urp")
CONTROLLER = Controller(
    "Universal Robots",
    "calibration.conf",
    "delta_theta[{axis}]",
    "rad",
    math.radians(1),
    "",
    (
        "Add the values to the values in the controller's calibration.conf; indices in [ ] start at 1.",
        "Keep a copy of calibration.conf; the controller reads the file when starting.",
    ),
    "docs.ros.org, ur_calibration: the DH parameters of a calibrated robot; "
    "github.com/savidini/match_ur_control_backup: units (W); the maker's forum, threads 538 and 18921 (W): the "
    "file can be written, and holds calibration_status = 2 for a linearised robot",
    "a, alpha and beta are not entered; whether a controller accepts a "
    "changed file with the old joint_checksum was not found: keep calibration_status and the checksums as they are",
    changes_reading=False,
    constants=(ConstantParameter("d_mm", "delta_d[{axis}]", "m", 1e-3),),
)
