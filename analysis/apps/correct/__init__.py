"""Corrections of a rig: zeros and constants of a controller, targets, and programs; the command `rig correct`."""
