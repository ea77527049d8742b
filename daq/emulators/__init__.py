"""Emulated instruments on real wires: ptys and sockets that speak the makers' protocols at the line's pace."""

from daq.emulators.cell import Adversity, Cell, as_emulated
from daq.emulators.instruments import Motion, emulated
from daq.emulators.replay import Replay

__all__ = ["Adversity", "Cell", "Motion", "Replay", "as_emulated", "emulated"]
