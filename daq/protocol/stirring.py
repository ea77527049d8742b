"""Resting now and then, so that an adapter which holds bytes back does not fall into step with the requests.

FTDI's latency timer is 16 ms. Where each request follows the answer before at once, its answers all wait alike; then no
answer of a run comes as quickly as the instrument gives it, and it is unknown when it was latched. So after `STIR`
requests the line rests for up to `STIR_NS`, each time for another time: half a second (`STIR_EVERY_NS`) apart at the
least, since it makes a hole in the readings of a quick instrument.
"""

from __future__ import annotations

STIR = 50
STIR_NS = 17_000_000
STIR_EVERY_NS = 500_000_000
_GOLDEN = 0.6180339887498949
"""Multiples of it, less their whole part, fill the range from 0 to 1 evenly, however many there are."""


class Stirring:
    """Counts the requests on a line, and says when it rests."""

    def __init__(self) -> None:
        self._requests = self._stirs = 0
        self._stirred_ns = 0

    def begin(self, now_ns: int) -> None:
        """Note that the link has just opened."""
        self._stirred_ns = now_ns

    def count(self) -> None:
        """Note a request."""
        self._requests += 1

    def rest_ns(self, now_ns: int) -> int:
        """Return how long the line rests after an answer; mostly 0."""
        if self._requests < STIR or now_ns < self._stirred_ns + STIR_EVERY_NS:
            return 0
        self._requests, self._stirred_ns = 0, now_ns
        self._stirs += 1
        return round(self._stirs * _GOLDEN % 1.0 * STIR_NS)
