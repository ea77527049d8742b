"""Helpers shared by tests and developer scripts, imported as `tests.support.NAME`."""
