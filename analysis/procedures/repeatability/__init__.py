"""Repeatability test: scatter of the distance in repeated approaches to a target."""

from analysis.procedures.facts import Labels

LABELS = Labels(
    example=("bi_mm", 0.05, 0.10), part="hemisphere", further=("repeatability", "the same places from both sides")
)
