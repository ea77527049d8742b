"""Arms from elsewhere, as the `robot:` section of a rig file: a URDF, or a UR's own calibration."""
