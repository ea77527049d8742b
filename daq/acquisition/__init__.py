"""Acquisition of samples: a reader thread and a buffer per stream, with checks of readings and clocks."""
