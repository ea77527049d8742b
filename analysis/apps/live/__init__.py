"""Live view of `rig live`: a pure model and pure drawing.

Only `loop` and `daemon_source` access the system.
"""
