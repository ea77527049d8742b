"""Description of a rig: the schema of the rig file, its loader, and the shipped rigs as YAML.

This is the lowest layer. It imports no other package of this project.
"""
