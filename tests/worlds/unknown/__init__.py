"""Robot cells with a cause of error outside rig's library of effects.

Nothing in this package imports rig. `arms` contains the kinematics, `causes` the physics of the causes, `motion` the
paths, `readings` the instruments, `cells` the random cells, `files` the tables and rig files for rig.
"""
