"""From a robot and two gauges to a checked rig file: the questions of `rig init`, and the file that they end in."""
