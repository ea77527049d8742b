"""Import of table files: parsing with errors by row, column maps, checks against the rig, and creation of runs."""
