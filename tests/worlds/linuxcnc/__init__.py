"""A cell on one machine: the real controller LinuxCNC without hardware, and an arm and gauges that are simulated.

Nothing here imports rig. The arm follows the motors of the controller, `joint.N.motor-pos-cmd`, with hidden faults. The
controller does not know them, and rig sees only the joints of the controller and the readings of two gauges.
"""
