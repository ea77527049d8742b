"""Conversion of recorded runs to tables: timestamps, alignment, laps, stops at targets, and columns of table files."""
