"""The correction: how a cell can use the effects in its rig file.

effects → whether each can be corrected, and how → zeros and link constants, corrected targets of a path
"""
