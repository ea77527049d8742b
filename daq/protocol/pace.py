"""When a device of constant rate speaks: an absolute schedule, of which no period drifts or is
lost."""

from __future__ import annotations

from collections.abc import Iterator


class Pace:
    """Gives the instants of a steady rate from `start_ns` on."""

    def __init__(self, rate_hz: float, start_ns: int) -> None:
        self._rate_hz = rate_hz
        self._start_ns = start_ns
        self._count = 0

    @property
    def next_ns(self) -> int:
        """The next instant that was not given yet."""
        return self._start_ns + round(self._count * 1e9 / self._rate_hz)

    def step(self, now_ns: int) -> int | None:
        """Return the next instant that was not given before; None if it has not come yet."""
        instant = self.next_ns
        if instant > now_ns:
            return None
        self._count += 1
        return instant

    def due(self, now_ns: int) -> Iterator[int]:
        """Return every instant up to now that was not given before."""
        while (instant := self.step(now_ns)) is not None:
            yield instant
