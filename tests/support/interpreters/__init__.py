"""Interpreters of what rig program writes in five robot languages, each from its maker's manual, none from the writers.

An interpreter reads a program strictly and drives a `Machine` with it: anything that it does not know is refused.
"""
