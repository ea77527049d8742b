"""Loading and alignment, the robot and its kinematics, effects, tests, simulation, plots, the command line.

Takes from `daq` only what reads a run, talks to a running daemon, or starts an emulator.
"""
