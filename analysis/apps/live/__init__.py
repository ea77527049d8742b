"""What `rig live` shows: a pure model and pure drawing; only `terminal`, `loop` and `daemon_source` touch a system."""
