"""Programs of the tests of a rig: motion plans, targets as tables, and the command `rig program`."""
