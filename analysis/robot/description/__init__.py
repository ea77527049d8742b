"""Import of arms into the `robot:` section of a rig file, and export: URDF, MJCF, and a UR's calibration."""
