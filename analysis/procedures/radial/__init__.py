"""Radial test: distance between tool and ball on a hemisphere."""

from analysis.procedures.facts import Labels

LABELS = Labels(
    example=("band_mm", 0.2, 0.3),
    part="hemisphere",
    further=("hemisphere (radial)", "many postures, by distance alone"),
    along="target",
)
