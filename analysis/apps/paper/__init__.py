"""Comparison of Oh 2019 with a simulated robot (`rig paper`); all values are computed, none stored."""
