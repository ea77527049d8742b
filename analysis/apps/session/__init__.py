"""Guided session: drive the programs, record and diagnose the runs, correct the robot and verify the correction."""
