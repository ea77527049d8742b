"""Table files: reading with every bad row named, checks against the rig, writing, MCAP."""
