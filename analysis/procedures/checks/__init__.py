"""Checks of data against conventions: the labelled meaning against possible other meanings, by a common likelihood.

`analysis.procedures.checks.check_runs` lists them; each convention is a file.
"""
