"""One thing that was looked at."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Verdict(StrEnum):
    """The verdict of a finding."""

    OK = "ok"
    DOUBTFUL = "doubtful"
    """It may work, and may be why it does not work well."""
    WRONG = "wrong"
    """It will not work like this."""


@dataclass(frozen=True)
class Finding:
    """A finding. about: a gauge, the robot, the disk …; what: what was found; remedy: empty if all is well."""

    about: str
    verdict: Verdict
    what: str
    remedy: str = ""


def ok(about: str, what: str) -> Finding:
    """Return a finding that all is well."""
    return Finding(about, Verdict.OK, what)


def doubtful(about: str, what: str, remedy: str) -> Finding:
    """Return a finding that deserves attention."""
    return Finding(about, Verdict.DOUBTFUL, what, remedy)


def wrong(about: str, what: str, remedy: str) -> Finding:
    """Return a finding that has to be corrected."""
    return Finding(about, Verdict.WRONG, what, remedy)
