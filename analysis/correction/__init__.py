"""Correction: use of the effects in a rig file by a cell.

effects → correctable or not, and how → zeros and link constants, corrected targets of a path
"""
