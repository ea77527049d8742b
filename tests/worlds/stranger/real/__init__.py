"""Realistic cases for the trial: cells with the noise of real ones, and arms with all healthy effects at full size."""
