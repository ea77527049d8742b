"""One thing that was looked at."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Verdict(StrEnum):
    """What to think of it."""

    OK = "ok"
    DOUBTFUL = "doubtful"
    """It may work, and may be why it does not work well."""
    WRONG = "wrong"
    """It will not work like this."""


@dataclass(frozen=True)
class Finding:
    """about: a gauge, the robot, the disk …; what: what was seen; remedy: what to do, empty where all is well."""

    about: str
    verdict: Verdict
    what: str
    remedy: str = ""


def ok(about: str, what: str) -> Finding:
    """As it should be."""
    return Finding(about, Verdict.OK, what)


def doubtful(about: str, what: str, remedy: str) -> Finding:
    """Worth a look."""
    return Finding(about, Verdict.DOUBTFUL, what, remedy)


def wrong(about: str, what: str, remedy: str) -> Finding:
    """To be mended."""
    return Finding(about, Verdict.WRONG, what, remedy)
