"""Pose test: tool poses seen by a tracker."""

from analysis.procedures.facts import Facts, Labels
from analysis.runs.noise.outliers import FITTED_SPREADS

FACTS = Facts(
    of_places=True,
    of_tracker=True,
    setup_terms=9,
    frame_terms=6,
    wild_spreads=FITTED_SPREADS,
    assumed_sd_mm=0.04,  # UR10, two visits (Landgraf et al. 2021)
)
LABELS = Labels(
    example=("rms_mm", 0.5, 1.0),
    setup="the places of the instrument and of the target on the tool",
    joints_fit="poses fit",
    rows="poses",
    distance_from="from the position computed from the joints",
    outlier_check="check that the tracker saw the target and that the robot was at rest",
)
