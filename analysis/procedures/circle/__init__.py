"""Yaw and roll tests: angle between link and tool over a circle."""

from analysis.procedures.facts import Facts, Labels

FACTS = Facts(setup_terms=5)
LABELS = Labels(example=("circular_deviation_mm", 0.05, 0.10), part="circle", along="phi_deg")
