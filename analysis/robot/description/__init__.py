"""Import of arms from URDF or a UR's calibration to the `robot:` section of a rig file, and export to URDF or MJCF."""
