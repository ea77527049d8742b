"""Selection of postures: expected errors of all postures that reach a target, the best sequence, and a map of part
positions.
"""
