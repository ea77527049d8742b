"""Measurements that are simulated: tables, runs in the store, and the robot of an emulated cell."""
