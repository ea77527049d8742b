"""Noise of readings: estimated from repeats, otherwise assumed with a wide prior."""
