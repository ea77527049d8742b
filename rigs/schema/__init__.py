"""Parts of a rig file, with a module for each, and the interface of effects."""
