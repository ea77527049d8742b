"""Fitting the forward model to tables, and what the fits are used for."""
