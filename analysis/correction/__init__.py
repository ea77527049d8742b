"""Correction: what a cell can use of the effects in its rig file.

effects → which of them are supported, and for what → zeros and link constants, corrected targets of a path
"""
