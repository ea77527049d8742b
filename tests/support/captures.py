"""Readings and faults of the drivers for a captured cell.

The captures in `tests/corpus` are of emulated cells with noisy cables and a gauge head that was off for a while; each
folder has a rig file, `cell.log` and the result of `heard`. A capture of a real cell may be added.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from daq.acquisition.streams import streams_of
from daq.protocol.conversation import Conversation, ConversationStep, Fault, Item, Sample
from daq.wire.capture import Capture, CaptureMark, Piece
from rigs.rig import Rig

CORPUS = Path(__file__).parents[1] / "corpus"


def heard(rig: Rig, capture: Capture) -> dict[str, dict[str, Any]]:
    """Result of decoding a capture by stream: counts, first sample and last sample."""
    return {stream.name: _told(_items(stream.host, capture.of(stream.name))) for stream in streams_of(rig)}


def _items(host: Callable[[], Conversation], pieces: Sequence[Piece]) -> list[Item]:
    items: list[Item] = []
    conversation, step = host(), ConversationStep()
    for piece in pieces:
        while step.wake_ns is not None and step.wake_ns < piece.at_ns:
            step = conversation.tick(step.wake_ns)
            items += step.items
        if piece.mark is CaptureMark.OPENED:
            conversation = host()
            step = conversation.connected(piece.at_ns)
        elif piece.mark is CaptureMark.CAME:
            step = conversation.received(piece.data, piece.at_ns)
        else:
            continue
        items += step.items
    return items


def _told(items: Sequence[Item]) -> dict[str, Any]:
    samples = [
        [None if math.isnan(value) else value for value in item.values] for item in items if isinstance(item, Sample)
    ]
    faults = Counter[str]()
    for item in items:
        if isinstance(item, Fault):
            faults[item.kind] += item.count
    return {"samples": len(samples), "faults": dict(faults), "first": samples[0], "last": samples[-1]}
