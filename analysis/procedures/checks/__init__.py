"""Conventions that data are held against: what is labelled against what may have been meant, by one likelihood.

`analysis.procedures.checks.check_runs` has the list; each convention is a file.
"""
