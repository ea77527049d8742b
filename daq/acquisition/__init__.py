"""Acquisition: one reader thread per stream, its buffer, and checks of readings and clocks."""
