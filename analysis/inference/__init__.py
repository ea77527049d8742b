"""Bayesian linear regression with levels by evidence: the statistics that several questions share."""
