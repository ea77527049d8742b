"""Emulated instruments on real wires: ptys and sockets that speak the makers' protocols at the line's pace."""

from daq.emulators.cell import Adversity, Cell, Motion

__all__ = ["Adversity", "Cell", "Motion"]
