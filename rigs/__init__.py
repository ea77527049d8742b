"""Description of a rig: the schema of the rig file, its loader, and the shipped rigs as YAML.

The lowest layer: imports no other package of this project.
"""
