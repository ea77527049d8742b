"""Creates the capture files of the corpus: `rigd --capture` on emulated cells with faults.

`python -m tests.support.corpus_recording NAME…` records them again. `test_corpus.py` checks that the drivers still
decode each capture as before. A capture of a real cell may be added: rig file, `cell.log`, and the result of `heard`.
"""

from __future__ import annotations

import json
import math
import shutil
import signal
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest import mock

import yaml

from daq import gauges
from daq.acquisition.streams import streams_of
from daq.protocol.conversation import Conversation, ConversationStep, Device, Fault, Item, Sample
from daq.wire.capture import HEAD, Capture, CaptureMark, Piece, read_capture
from rigs.load import parse
from rigs.rig import Rig
from tests.support.bench import BIN, Bench, ByHand, rig_text

CORPUS = Path(__file__).parents[1] / "corpus"
_SAMPLES = 45
"""Minimum number of samples of the slowest stream."""


def cells() -> dict[str, dict[str, Any]]:
    """Return gauges and feedback of each cell, as parts of a rig file, by name. In cells with two gauges the second
    one moves.
    """
    serial, tcp, udp = "/dev/ttyUSB0", "tcp://127.0.0.1:9000", "udp://127.0.0.1:9000"
    slow = {"timeout_s": 2.0, "port": serial}
    block = yaml.safe_load(rig_text("modbus"))["gauges"]["g1"]
    return {
        "sylvac-lines": {"gauge": {"interface": "sylvac_opto_rs", "mode": "continuous", **slow},
                         "feedback": {"interface": "line_feed", "port": tcp}},
        "keyence-rtde": {"gauge": {"interface": "keyence_dl_rs1a", "line": "115200 8N1", **slow}, "shared": True,
                         "feedback": {"interface": "ur_rtde", "rate_hz": 60, "port": tcp}},
        "baumer-joints": {"gauge": {**block, **slow},
                          "feedback": {"interface": "modbus_joints", "port": tcp, "address": 100, "count": 12,
                                       "rate_hz": 50, "joints": [{"address": 100 + 2 * axis, "type": "float32"}
                                                                 for axis in range(6)]}},
        "mahr-rsi": {"gauge": {"interface": "mahr_c1202", "line": "57600 7E2", **slow}, "shared": True,
                     "feedback": {"interface": "kuka_rsi", "cycle_ms": 12, "port": udp}},
        "heidenhain-egm": {"gauge": {"interface": "heidenhain_nd281b", "line": "57600 7E2", **slow},
                           "feedback": {"interface": "abb_egm", "port": udp}},
        "mitutoyo-fanuc": {"gauge": {"interface": "mitutoyo_usb", **slow},
                           "feedback": {"interface": "fanuc_stream_motion", "port": udp}},
    }  # fmt: skip


def rig_file(cell: dict[str, Any]) -> str:
    data = yaml.safe_load(rig_text())
    other = {"channel": 2} if cell.get("shared") else {"port": "/dev/ttyUSB1"}
    data["gauges"] = {"g1": {**cell["gauge"], "offset_mm": 25}, "g2": {**cell["gauge"], **other, "offset_mm": -25}}
    data["feedback"] = cell["feedback"]
    return yaml.safe_dump(data, sort_keys=False)


def record(name: str) -> None:
    """Capture a cell with noisy cables and a gauge head that is temporarily off."""
    text = rig_file(cells()[name])
    folder, device = CORPUS / name, gauges.device
    bad = mock.patch.object(gauges, "device", lambda *given: BadCable(device(*given)))
    with bad, tempfile.TemporaryDirectory() as scratch, Bench(Path(scratch), text, motion := ByHand()) as bench:
        bench.start((BIN / "rigd", "--capture", "cell.log"))
        _more(bench)
        motion.mm["g1"] = math.nan
        bench.until(lambda state: any(one["counters"].get("device_error") for one in state["streams"].values()))
        motion.mm["g1"] = -0.25
        _more(bench)
        bench.signalled(signal.SIGTERM)
        capture = read_capture(Path(scratch) / "cell.log")
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    (folder / "rig.yaml").write_text(text)
    pieces = list(told(capture, parse(text, name)))
    (folder / "cell.log").write_text("\n".join([HEAD, *(piece.line() for piece in pieces), ""]))


def _more(bench: Bench) -> None:
    before = {name: one["counters"].get("samples", 0) for name, one in bench.status()["streams"].items()}
    bench.until(
        lambda state: all(
            state["streams"][name]["counters"].get("samples", 0) > count + _SAMPLES for name, count in before.items()
        )
    )


class BadCable:
    """An instrument with a flipped bit in every 41st transmission."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self._count = 0

    @property
    def sent(self) -> int:
        return self._device.sent

    def connected(self, now_ns: int) -> ConversationStep:
        return self._bent(self._device.connected(now_ns))

    def received(self, data: bytes, now_ns: int) -> ConversationStep:
        return self._bent(self._device.received(data, now_ns))

    def tick(self, now_ns: int) -> ConversationStep:
        return self._bent(self._device.tick(now_ns))

    def _bent(self, step: ConversationStep) -> ConversationStep:
        self._count += bool(step.send)
        if not step.send or self._count % 41:
            return step
        middle = len(step.send) // 2
        return replace(step, send=step.send[:middle] + bytes([step.send[middle] ^ 0x10]) + step.send[middle + 1 :])


def told(capture: Capture, rig: Rig) -> Iterator[Piece]:
    """Pieces of a capture from time zero, with the port names of the rig file."""
    begin_ns = capture.pieces[0].at_ns
    ports = {stream.name: stream.port for stream in streams_of(rig)}
    for piece in capture.pieces:
        data = ports[piece.stream].encode() if piece.mark is CaptureMark.OPENED else piece.data
        yield replace(piece, at_ns=piece.at_ns - begin_ns, data=data)


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


if __name__ == "__main__":
    for name in sys.argv[1:] or cells():
        record(name)
        folder = CORPUS / name
        found = heard(parse((folder / "rig.yaml").read_text(), name), read_capture(folder / "cell.log"))
        (folder / "heard.json").write_text(json.dumps(found, indent=1) + "\n")
        print(name, {stream: (one["samples"], one["faults"]) for stream, one in found.items()})
