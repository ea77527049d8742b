"""The parts of a rig file, one a file, and what every effect has."""
