"""Trial of unknown causes: cells of `tests/worlds/unknown`, evaluated by rig's diagnosis and recommendations."""
