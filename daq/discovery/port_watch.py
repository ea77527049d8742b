"""Identification of a gauge by a push: all gauges are read until the user pushes one of them."""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Mapping, Sequence
from functools import partial
from types import TracebackType

from daq import clock
from daq.acquisition.stream_buffer import samples_of
from daq.acquisition.streams import Stream
from daq.discovery.attempts import FoundGauge
from daq.discovery.port_search import LISTEN_S, host_of, join_started
from daq.protocol.conversation import Item
from daq.wire.conversation_loop import run_conversation
from daq.wire.links import LinkLost
from rigs.errors import CellError

PUSH_MM = 0.2
"""Motion that counts as a push. A ball link at rest and gauge noise move a plunger less."""
_MORE = 3.0
"""Minimum ratio of the push to the motion of the others, and to the scatter at rest."""
_AT_REST = 5
"""Readings that define the rest position."""
_KEPT = 200
_SILENCES = 10
"""Time-outs before the first reading after which a gauge counts as lost."""
_SETTLE_S = 5.0
"""Time for measuring the rest positions. The slowest gauges deliver a few readings per second."""


def pushed_gauge(rest_mm: Mapping[str, Sequence[float]], now_mm: Mapping[str, float]) -> str | None:
    """Place of the only gauge that moved, by the readings at rest and now by place."""
    resting = {place: readings for place, readings in rest_mm.items() if len(readings) >= _AT_REST and place in now_mm}
    moved = {place: abs(now_mm[place] - sorted(readings)[len(readings) // 2]) for place, readings in resting.items()}
    unrest = {place: max(readings) - min(readings) for place, readings in resting.items()}
    for place, by_mm in moved.items():
        others = max((travel_mm for name, travel_mm in moved.items() if name != place), default=0.0)
        if by_mm > max(PUSH_MM, _MORE * unrest[place], _MORE * others):
            return place
    return None


class PortWatch:
    """Reads gauges in a thread for each port."""

    def __init__(self, gauges: Sequence[FoundGauge]) -> None:
        self._gauges = gauges
        self._stop = clock.Event()
        self._lock = threading.Lock()
        self._arrived = clock.Event()
        """Set when a port has delivered or was lost."""
        self._rest: dict[str, list[float]] = {}
        self._latest: dict[str, deque[float]] = {gauge.place: deque(maxlen=_KEPT) for gauge in gauges}
        self._lost: dict[str, str] = {}
        self._threads: list[threading.Thread] = []

    def __enter__(self) -> PortWatch:
        by_port: dict[str, list[FoundGauge]] = {}
        for gauge in self._gauges:
            by_port.setdefault(gauge.gauge.port, []).append(gauge)
        self._threads = [
            clock.Thread(target=self._read, args=(group,), name=f"watch {port}") for port, group in by_port.items()
        ]
        try:
            for thread in self._threads:
                thread.start()
        except BaseException:  # Ctrl-C between two threads
            self._end()
            raise
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._end()

    def readings_mm(self) -> dict[str, float]:
        with self._lock:
            for place, why in self._lost.items():
                remedy = "check the cable, and repeat rig init: it continues here"
                raise CellError(place, f"was lost ({why})", remedy, code="port.silent")
            return {place: values[-1] for place, values in self._latest.items() if values}

    def measure_rest(self) -> None:
        """Measure the rest positions. Raises CellError if a gauge is silent."""
        with self._lock:
            for values in self._latest.values():
                values.clear()
        until_s = clock.now_s() + _SETTLE_S
        while not self._is_settled() and (remaining_s := until_s - clock.now_s()) > 0:
            self._arrived.wait(remaining_s)
        with self._lock:
            self._rest = {place: list(values) for place, values in self._latest.items()}
        self.readings_mm()

    def _is_settled(self) -> bool:
        with self._lock:
            self._arrived.clear()
            return bool(self._lost) or all(len(values) >= _AT_REST for values in self._latest.values())

    def pushed_gauge(self, places: Sequence[str]) -> str | None:
        now_mm = self.readings_mm()
        return pushed_gauge({place: self._rest[place] for place in places}, now_mm)

    def grows(self, place: str) -> bool:
        with self._lock:
            rest_mm = sorted(self._rest[place])[len(self._rest[place]) // 2]
            return max(self._latest[place], key=lambda reading: abs(reading - rest_mm)) > rest_mm

    def _end(self) -> None:
        self._stop.set()
        join_started(self._threads)

    def _read(self, group: Sequence[FoundGauge]) -> None:
        members = [gauge.gauge for gauge in group]
        host = partial(host_of, members, group[0].sends, LISTEN_S, _SILENCES)
        stream = Stream(members[0].port, (), members[0].port, members[0].line, host, modem=members[0].modem)

        def deliver(items: Sequence[Item]) -> None:
            samples = samples_of(items)
            with self._lock:
                for sample in samples:
                    for gauge, value in zip(group, sample.values, strict=True):
                        if math.isfinite(value):
                            self._latest[gauge.place].append(value)
                self._arrived.set()

        try:
            link = stream.open()
            try:
                run_conversation(link, stream.host(), deliver, self._stop.is_set)
                if not self._stop.is_set():
                    raise LinkLost("nothing arrived")
            finally:
                link.close()
        except (LinkLost, CellError) as error:
            with self._lock:
                self._lost.update((gauge.place, str(error)) for gauge in group)
                self._arrived.set()
