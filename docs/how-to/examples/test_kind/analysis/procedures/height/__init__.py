"""Height test: a height gauge on a table next to the arm touches the tool at each stop of the robot.

The measured height less the height by the nominal arm is the height of the arm's base above the table, equal in all
postures. The deviation from its mean is the vertical error of the arm.
"""

from analysis.procedures.facts import Labels

LABELS = Labels(unsupported_reason="is a table of heights, which a diagnosis does not use")
