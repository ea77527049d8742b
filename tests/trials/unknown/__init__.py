"""The trial of causes outside the library: cells of `tests/worlds/unknown`, judged by what rig says and advises."""
