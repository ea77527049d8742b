"""Conventions that data are held against: what is labelled against what may have been meant, by one likelihood.

`analysis.conventions.check` has the list; each convention is a file.
"""
