"""Conversations of gauges by their manuals, each in two files of tests/daq/conversations.

`NAME.log` has the gauges, the requests (`>`) and the replies (`<`). `NAME.readings` has a line for each reply to the
last request: the values in mm, or the kind of the fault.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import daq.gauges
from tests.support.drivers import gauge
from tests.support.simulated_conversation import Script

FOLDER = Path(__file__).parents[1] / "daq" / "conversations"


@dataclass(frozen=True)
class GaugeReplies:
    """Gauges on a line, the exchanges before, the request, and each reply with what is expected of it."""

    gauges: tuple[Any, ...]
    before: tuple[tuple[bytes, bytes], ...]
    request: bytes
    replies: dict[bytes, str]

    def begun(self) -> Script:
        """The conversation just after the request has been sent."""
        script = Script(daq.gauges.host(self.gauges))
        script.wake()
        for request, reply in self.before:
            assert script.sent == request
            script.sent = b""
            script.receive(reply)
        assert script.sent.endswith(self.request)
        script.sent = b""
        assert script.taken() == []
        return script


def recorded(log: Path) -> GaugeReplies:
    gauges, sides = [], list[tuple[str, bytes]]()
    for line in log.read_text(encoding="ascii").splitlines():
        side, _, text = line.partition(" ")
        if side == "gauge":
            interface, _, keys = text.partition(" ")
            gauges.append(gauge(interface, **json.loads(keys or "{}")))
        else:
            sides.append((side, text.encode().decode("unicode_escape").encode("latin1")))
    asked = max(k for k, (side, _) in enumerate(sides) if side == ">")
    before = [data for _, data in sides[:asked]]
    replies = [data for _, data in sides[asked + 1 :]]
    expected = log.with_suffix(".readings").read_text(encoding="ascii").splitlines()
    pairs = tuple(zip(before[::2], before[1::2], strict=True))
    return GaugeReplies(tuple(gauges), pairs, sides[asked][1], dict(zip(replies, expected, strict=True)))


POLLED = {log.stem: recorded(log) for log in sorted(FOLDER.glob("*.log"))}
