"""What a rig is: the schema of a rig file, its loader, and the shipped rigs as YAML.

The ground floor of the house: imports nothing of ours.
"""
