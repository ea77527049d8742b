"""Path test: tool positions along the paths of the cube seen by a tracker."""

from analysis.procedures.facts import Labels

LABELS = Labels(
    example=("line_at_mm", 0.5, 1.0),
    unsupported_reason="is a path without joint angles, which cannot show single joints",
)
