"""The live view of `rig live`: a pure model with pure drawing; only `terminal`, `loop` and `daemon_source` touch the
system."""
