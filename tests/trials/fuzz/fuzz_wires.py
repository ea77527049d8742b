"""Mutated bytes to both sides of every protocol, in random pieces at random times.

The good bytes are real conversations of the two sides. Each conversation gets several inputs; then, once the line has
been quiet, it must still be able to do its work with a sound peer, or have hung up, which makes a new one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache, partial
from random import Random

import daq.feedback
import daq.gauges
from daq.protocol.conversation import Conversation, ConversationStep, Device, FaultKind, Item, Sample
from daq.protocol.framing import LIMIT
from daq.protocol.websocket import LIMIT as WEBSOCKET_LIMIT
from daq.store.chunk import batch_of, schema_of
from rigs.schema.feedback import carries_signal, columns_beside_joints
from tests.support.drivers import FEEDBACKS, GAUGES
from tests.support.simulated_conversation import S, held, simulate
from tests.trials.fuzz.mutation import mutated

INPUTS = 20
"""To one conversation, at the most: one that has hung up hears no more."""
HELD_MAX = 3 * LIMIT
_CHARACTER_NS = 100_000
_RECOVERY_NS = 30 * S
_HELD_BY = {"ros2_joint_states": 3 * WEBSOCKET_LIMIT, "opc_ua_robotics": 2 << 20}
"""Bytes that interfaces with long messages may hold: twice the longest of OPC UA, which only its package names."""
_LARGEST_STEP = 150_000
"""Bytes of a device after a second in which nobody woke it: at most 500 messages of 300 bytes."""
_STARTS_NS = (0, 10**18)
Feed = Callable[[Random], int]
"""Function that feeds a conversation and returns the number of inputs until the end; raises an exception on failure."""


def wires() -> dict[str, list[Feed]]:
    """For each interface what feeds its sides, in each of the configurations of `drivers`."""
    found: dict[str, list[Feed]] = {}
    for _, gauges, _ in GAUGES:
        host, device = partial(daq.gauges.host, gauges), partial(daq.gauges.device, gauges, _Readings(len(gauges)))
        found.setdefault(gauges[0].interface, []).extend(_sides(host, device, len(gauges)))
    for _, feedback in FEEDBACKS:
        shown = _Readings(6 + carries_signal(feedback))
        host, device = partial(daq.feedback.host, feedback), partial(daq.feedback.device, feedback, shown)
        width = 6 + len(columns_beside_joints(feedback))
        held_max = _HELD_BY.get(feedback.interface, HELD_MAX)
        found.setdefault(feedback.interface, []).extend(_sides(host, device, width, held_max))
    return found


class _Readings:
    """Readings that vary within the range of every gauge, a head off now and then."""

    def __init__(self, count: int) -> None:
        self._count = count

    def __call__(self, now_ns: int) -> Sequence[float]:
        off = self._count < 6 and now_ns // 100_000_000 % 7 == 3
        return [math.nan if off else math.sin(now_ns * 1e-9 + axis) * 5 for axis in range(self._count)]


def _sides(
    host: Callable[[], Conversation], device: Callable[[], Device], width: int, held_max: int = HELD_MAX
) -> list[Feed]:
    @cache
    def said() -> tuple[list[bytes], list[bytes]]:
        """Bytes that each side receives from the other without faults."""
        ours, theirs = _Overheard(host()), _Overheard(device())
        simulate(ours, theirs, 2 * S, character_ns=_CHARACTER_NS)
        return theirs.said[:200], ours.said[:200] or [b"?\r"]

    def feed_host(dice: Random) -> int:
        to_host, _ = said()
        conversation = Watched(host(), dice, width, dice.choice(_STARTS_NS), held_max)
        peer = device()
        conversation.feed(to_host, peer)
        if not conversation.over:
            # Repeated lines of another resolution are learned; the true one is then refused, by name.
            assert _works(conversation, peer) or conversation.refuses_unit, "no reading after a quiet line"
        return conversation.inputs

    def feed_device(dice: Random) -> int:
        _, to_device = said()
        conversation = Watched(device(), dice, width, dice.choice(_STARTS_NS), held_max)
        conversation.feed(to_device, None)
        if not conversation.over:
            assert _works(Watched(host(), dice, width, conversation.now_ns), conversation), "the device answers no more"
        return conversation.inputs

    return [feed_host, feed_device]


class _Overheard:
    """A conversation, and what it said."""

    sent = 0

    def __init__(self, conversation: Conversation) -> None:
        self._conversation = conversation
        self.said: list[bytes] = []

    def connected(self, now_ns: int) -> ConversationStep:
        return self._heard(self._conversation.connected(now_ns))

    def received(self, data: bytes, now_ns: int) -> ConversationStep:
        return self._heard(self._conversation.received(data, now_ns))

    def tick(self, now_ns: int) -> ConversationStep:
        return self._heard(self._conversation.tick(now_ns))

    def _heard(self, step: ConversationStep) -> ConversationStep:
        if step.send:
            self.said.append(step.send)
        return step


class Watched:
    """A conversation that is held to its bounds at each step."""

    sent = 0

    def __init__(
        self, conversation: Conversation, dice: Random, width: int, now_ns: int, held_max: int = HELD_MAX
    ) -> None:
        self._conversation, self._dice = conversation, dice
        self._schema = schema_of("x", [f"v{k}" for k in range(width)])
        self._width = width
        self._held_max = held_max
        self.now_ns = now_ns
        self.over = False
        self.inputs = 0
        self.said: list[bytes] = []
        """Inputs, for a report."""
        self.samples: list[Sample] = []
        self.refuses_unit = False
        self.step = self._keep(conversation.connected(self.now_ns), 0)

    def feed(self, corpus: Sequence[bytes], peer: Conversation | None) -> None:
        """Several inputs; a sound peer's answers among them bring it further than its first state."""
        for _ in range(INPUTS):
            data = mutated(self._dice, corpus)
            if peer is not None and self.step.send and self._dice.random() < 0.5:
                data = peer.received(self.step.send, self.now_ns).send + data
            self.said.append(data)
            self._pieces(data)
            if self.over:
                break
        if not self.over:
            self.received(self._dice.choice((b"x", b"+", b"\0", b"\xff")) * 4 * LIMIT, self.now_ns)
        assert held(self._conversation) <= self._held_max, f"keeps {held(self._conversation)} bytes and more"
        if self.samples:
            batch_of(self.samples[:20], self._schema, 0)

    def _pieces(self, data: bytes) -> None:
        heard = False
        while True:
            size = self._dice.choice((1, 3, 17, len(data), len(data)))
            self.wait(self._dice.choice((0, 1000, 10**6, 10**8, 10**9)))
            if self.over:
                return
            if data[:size]:
                self.inputs, heard = self.inputs + (not heard), True
                self.received(data[:size], self.now_ns)
            data = data[size:] if size else b""
            if not data:
                return

    def wait(self, for_ns: int) -> None:
        """Let time pass, woken as it wishes."""
        until_ns = self.now_ns + for_ns
        for _ in range(100):
            wake_ns = self.step.wake_ns
            if self.over or wake_ns is None or wake_ns > until_ns:
                break
            self.now_ns = max(self.now_ns, wake_ns) + 1000
            self.tick(self.now_ns)
        self.now_ns = max(self.now_ns, until_ns)

    def connected(self, now_ns: int) -> ConversationStep:
        return self.step

    def received(self, data: bytes, now_ns: int) -> ConversationStep:
        return self._keep(self._conversation.received(data, now_ns), len(data))

    def tick(self, now_ns: int) -> ConversationStep:
        return self._keep(self._conversation.tick(now_ns), 0)

    def _keep(self, step: ConversationStep, size: int) -> ConversationStep:
        self.step, self.over = step, self.over or step.hang_up
        assert len(step.items) <= size + 8, f"{len(step.items)} items of {size} bytes"
        assert len(step.send) <= 600 * size + _LARGEST_STEP, f"{len(step.send)} bytes to {size}"
        for item in step.items:
            self._check(item)
        return step

    def _check(self, item: Item) -> None:
        if not isinstance(item, Sample):
            assert item.count >= 0 and len(item.detail) < 1500, item
            self.refuses_unit = item.kind is FaultKind.UNIT_CHANGED
            return
        assert len(item.values) == self._width and not any(map(math.isinf, item.values)), item
        assert item.first_byte_ns <= item.last_byte_ns and not math.isinf(item.device_time_s), item
        self.samples.append(item)


def _works(host: Watched, device: Conversation) -> bool:
    """True if both sides, joined after a pause, give a reading or one of them closes the connection."""
    now_ns = max(host.now_ns, device.now_ns if isinstance(device, Watched) else 0)
    end_ns, count = now_ns + _RECOVERY_NS, len(host.samples)
    step = device.step if isinstance(device, Watched) else device.connected(now_ns)
    asked = host.step.send
    for _ in range(3000):
        step = device.received(asked, now_ns) if asked else step
        asked = host.received(step.send, now_ns).send if step.send else b""
        now_ns += len(step.send) * _CHARACTER_NS
        if len(host.samples) > count or host.over or step.hang_up:
            return True
        wakes = [wake_ns for wake_ns in (host.step.wake_ns, step.wake_ns) if wake_ns is not None]
        if not asked:
            now_ns = max(now_ns + 1000, min(wakes, default=end_ns))
        if now_ns > end_ns:
            return False
        if not asked and step.wake_ns is not None and step.wake_ns <= now_ns:
            step = device.tick(now_ns)
            continue
        step = ConversationStep(wake_ns=step.wake_ns)
        if not asked and host.step.wake_ns is not None and host.step.wake_ns <= now_ns:
            asked = host.tick(now_ns).send
    return False
