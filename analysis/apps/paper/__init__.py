"""Comparison of Oh 2019 with a simulated robot (`rig paper`). All values are computed, none are stored."""
