"""Device side of a captured connection on the timebase of a replay: streaming and answering players."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from statistics import median

from daq.emulators.timebase import Steps, Timebase
from daq.protocol.conversation import ConversationStep
from daq.wire.capture import CaptureMark, Piece

_LOOK_NS = 20_000_000
"""Interval for checking whether the replay has started."""
_PATIENCE_NS = 1_000_000_000
"""Time to wait for captured data of the host. Afterwards the instrument continues regardless."""
_AROUND = 8
"""Exchanges searched before and after a request. An instrument receives few kinds of requests in turn."""


class StreamingPlayer:
    def __init__(self, pieces: Sequence[Piece], time: Timebase, steps: Steps, *, hangs_up: bool, calls: bool) -> None:
        """hangs_up: close the link at the end, as over TCP.

        calls: send to a port of the host and detect whether it is open.
        """
        self.sent = 0
        self._pieces = pieces
        self._time, self._steps = time, steps
        self._hangs_up, self._calls = hangs_up, calls
        self._begin()

    @property
    def is_finished(self) -> bool:
        return not self._left

    @property
    def begun(self) -> bool:
        return self._time.shift_ns is not None and len(self._left) < self._whole

    def connected(self, now_ns: int) -> ConversationStep:
        if self._hangs_up and self._pieces:
            self._time.begin(now_ns, self._pieces[0].at_ns)
        return self._play(now_ns)

    def received(self, data: bytes, now_ns: int) -> ConversationStep:
        first = next((piece for piece in self._pieces if piece.mark is CaptureMark.SENT), None)
        if first is not None:
            self._time.begin(now_ns, first.at_ns)
        self._replayed += data
        return self._play(now_ns)

    def tick(self, now_ns: int) -> ConversationStep:
        return self._play(now_ns)

    def _begin(self) -> None:
        self._turn = self._time.turn
        spoken = [piece for piece in self._pieces if piece.mark in (CaptureMark.SENT, CaptureMark.CAME)]
        while spoken and spoken[-1].mark is CaptureMark.SENT:
            spoken.pop()  # not followed by any data
        self._left, self._whole = deque(spoken), len(spoken)
        self._end_ns = self._pieces[-1].at_ns if self._pieces else 0
        self._replayed = bytearray()
        self._knocked_ns: int | None = None

    def _play(self, now_ns: int) -> ConversationStep:
        """At most one received chunk. Over UDP each chunk is a datagram."""
        if self._turn != self._time.turn:
            self._begin()
        shift_ns = self._time.shift_ns
        if shift_ns is None and self._pieces:
            return self._knock(now_ns) if self._calls else ConversationStep(wake_ns=now_ns + _LOOK_NS)
        while self._left and shift_ns is not None:
            piece = self._left[0]
            due_ns = shift_ns + piece.at_ns
            if now_ns < due_ns:
                return ConversationStep(wake_ns=due_ns)
            if piece.mark is CaptureMark.CAME:
                self._left.popleft()
                self._steps.record_delay(piece.at_ns, now_ns - due_ns)
                self.sent += 1
                return ConversationStep(piece.data, wake_ns=now_ns)
            if len(self._replayed) < len(piece.data) and now_ns < due_ns + _PATIENCE_NS:
                return ConversationStep(wake_ns=due_ns + _PATIENCE_NS)
            self._left.popleft()
            self._steps.otherwise += self._replayed[: len(piece.data)] != piece.data
            del self._replayed[: len(piece.data)]
        self._steps.judge()
        if not self._hangs_up:
            return ConversationStep()
        over_ns = self._end_ns + (shift_ns or 0)
        return ConversationStep(hang_up=True) if now_ns >= over_ns else ConversationStep(wake_ns=over_ns)

    def _knock(self, now_ns: int) -> ConversationStep:
        """Send the first piece. If no process listens at the port, the link is lost; otherwise the timebase starts."""
        if self._knocked_ns is None:
            self._knocked_ns = now_ns
            self.sent += 1
            return ConversationStep(self._left.popleft().data, wake_ns=now_ns + _LOOK_NS)
        self._time.begin(self._knocked_ns, self._pieces[0].at_ns)
        return ConversationStep(wake_ns=now_ns)


@dataclass(frozen=True, slots=True)
class Exchange:
    asked_ns: int
    question: bytes
    answers: tuple[Piece, ...]

    def answers_to(self, question: bytes) -> tuple[Piece, ...] | None:
        """Answers to this request; None if the request differs.

        A number repeated in the answer (Modbus TCP) may differ.
        """
        if question == self.question:
            return self.answers
        if len(question) != len(self.question) or not self.answers:
            return None
        first, *further = self.answers
        answer = bytearray(first.data)
        for place, (asked, then) in enumerate(zip(question, self.question, strict=True)):
            if asked != then:
                if answer[place : place + 1] != bytes([then]):
                    return None
                answer[place] = asked
        return (Piece(first.at_ns, first.stream, first.mark, bytes(answer)), *further)


@dataclass(frozen=True, slots=True)
class Exchanges:
    all: Sequence[Exchange]
    asked_ns: Sequence[int]
    begin_ns: int
    end_ns: int
    period_ns: float
    longest: int

    @classmethod
    def of(cls, pieces: Sequence[Piece]) -> Exchanges:
        """Pair each captured request with its answers; ignore data before the first request."""
        questions = [number for number, piece in enumerate(pieces) if piece.mark is CaptureMark.SENT]
        exchanges = [
            Exchange(
                pieces[begin].at_ns,
                pieces[begin].data,
                tuple(piece for piece in pieces[begin:end] if piece.mark is CaptureMark.CAME),
            )
            for begin, end in pairwise([*questions, len(pieces)])
        ]
        asked_ns = [exchange.asked_ns for exchange in exchanges]
        period_ns = median([after - before for before, after in pairwise(asked_ns)] or [0])
        longest = max((len(exchange.question) for exchange in exchanges), default=0)
        return cls(exchanges, asked_ns, pieces[0].at_ns, pieces[-1].at_ns, period_ns, longest)


class AnsweringPlayer:
    def __init__(self, exchanges: Exchanges, time: Timebase, steps: Steps, *, hangs_up: bool) -> None:
        self.sent = 0
        self._exchanges = exchanges
        self._time, self._steps = time, steps
        self._hangs_up = hangs_up
        self._begin()

    @property
    def begun(self) -> bool:
        return self._last >= 0

    def connected(self, now_ns: int) -> ConversationStep:
        if self._hangs_up:
            self._time.begin(now_ns, self._exchanges.begin_ns)
        return self._play(now_ns)

    def received(self, data: bytes, now_ns: int) -> ConversationStep:
        if self._exchanges.all:
            self._time.begin(now_ns, self._exchanges.asked_ns[0])
        self._replayed += data
        return self._play(now_ns, asked=True)

    def tick(self, now_ns: int) -> ConversationStep:
        return self._play(now_ns)

    def _begin(self) -> None:
        self._turn = self._time.turn
        self.is_finished = not self._exchanges.all
        self._replayed = bytearray()
        self._last = -1
        self._saying: deque[Piece] = deque()
        self._middle_ns: float | None = None
        """Time shift of the current exchange, until the answer begins."""
        self._question_ns = 0

    def _play(self, now_ns: int, *, asked: bool = False) -> ConversationStep:
        if self._turn != self._time.turn:
            self._begin()
        shift_ns = self._time.shift_ns
        if shift_ns is None:
            return ConversationStep(wake_ns=now_ns + _LOOK_NS)
        at_ns = now_ns - shift_ns
        if asked:
            self._hear(at_ns)
        if self._saying and at_ns >= self._saying[0].at_ns:
            if self._middle_ns is not None:
                self._steps.record_delay(at_ns, (self._question_ns + at_ns) / 2 - self._middle_ns)
                self._middle_ns = None
            self.sent += 1
            data = bytearray()
            while self._saying and at_ns >= self._saying[0].at_ns:
                data += self._saying.popleft().data
            return ConversationStep(bytes(data), wake_ns=now_ns)
        if not self.is_finished and at_ns >= self._exchanges.end_ns:
            self.is_finished = True
            self._skip_to(len(self._exchanges.all))
        if self.is_finished and not self._saying:
            self._steps.judge()
            return ConversationStep(hang_up=self._hangs_up)
        next_ns = self._saying[0].at_ns if self._saying else self._exchanges.end_ns
        return ConversationStep(wake_ns=next_ns + shift_ns)

    def _hear(self, at_ns: int) -> None:
        if at_ns >= self._exchanges.end_ns:
            return
        exchange = self._nearest(at_ns, bytes(self._replayed))
        if exchange is None:
            if len(self._replayed) >= self._exchanges.longest:
                self._steps.otherwise += 1
                self._replayed.clear()
            return
        number, answers = exchange
        self._replayed.clear()
        self._skip_to(number)
        self._steps.repeated += number <= self._last
        self._last = max(self._last, number)
        late_ns = at_ns - self._exchanges.asked_ns[number]
        wait_ns = answers[0].at_ns - self._exchanges.asked_ns[number] if answers else 0
        slip_ns = late_ns if late_ns > wait_ns else 0
        self._saying = deque(Piece(piece.at_ns + slip_ns, piece.stream, piece.mark, piece.data) for piece in answers)
        self._question_ns = at_ns
        self._middle_ns = self._exchanges.asked_ns[number] + wait_ns / 2 if answers else None

    def _skip_to(self, number: int) -> None:
        self._steps.skipped += sum(bool(exchange.answers) for exchange in self._exchanges.all[self._last + 1 : number])

    def _nearest(self, at_ns: int, question: bytes) -> tuple[int, tuple[Piece, ...]] | None:
        """Index and answers of the nearest exchange with this request.

        An early request waits while the answer is measured: its error is half of that of an equally late request, as
        that of a late one whose answer is not due yet, which is answered if the figures tolerate it.
        """
        after = bisect_right(self._exchanges.asked_ns, at_ns)
        before = self._first_with(question, range(after - 1, max(after - 1 - _AROUND, -1), -1))
        following = self._first_with(question, range(after, min(after + _AROUND, len(self._exchanges.all))))
        if before is None:
            return following
        if following is None:
            return before
        number, answers = before
        late_ns, early_ns = at_ns - self._exchanges.asked_ns[number], self._exchanges.asked_ns[following[0]] - at_ns
        if answers and number > self._last and at_ns < answers[0].at_ns and late_ns / 2 <= self._steps.bearable_ns:
            return before
        return before if late_ns <= min(early_ns, self._exchanges.period_ns) / 2 else following

    def _first_with(self, question: bytes, numbers: range) -> tuple[int, tuple[Piece, ...]] | None:
        for number in numbers:
            answers = self._exchanges.all[number].answers_to(question)
            if answers is not None:
                return number, answers
        return None
