"""Fitting of the forward model to runs: set-ups, effects, noise and weights, and the uncertainty of what was fitted."""
