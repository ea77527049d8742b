"""Correction of a robot by the effects in a rig file.

The chain: effects, their use for a correction, corrected zeros and link constants, corrected targets of a path.
"""
