"""Shipped rig files whose controller is stated to compute with the data sheet, as the emulated controllers do."""

from __future__ import annotations

from rigs.load import load as load_shipped
from rigs.load import parse
from rigs.rig import Rig


def load(name: str) -> tuple[Rig, str]:
    """A shipped rig and the text of its file, with `controller: data_sheet`."""
    rig, text = load_shipped(name)
    if rig.robot.controller:
        return rig, text
    text = text.replace("\n  axes:", "\n  controller: data_sheet\n  axes:", 1)
    return parse(text, name), text
