"""Parts of a rig file, one per module, and the interface of effects."""
