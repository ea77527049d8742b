"""Noise of readings: estimated from repeats, or assumed with a wide prior."""
