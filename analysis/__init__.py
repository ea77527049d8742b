"""Kinematics, tables of runs, measures, the forward model and its fits, diagnosis, reports, the command line.

Takes from `daq` only what reads a run, talks to a running daemon, or starts an emulator. What
may import what: docs/decisions/0014.
"""
