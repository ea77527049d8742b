"""Whom and what a report is for, at its head: the robot's serial number, customer, order, and who measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from analysis.api import Result
from analysis.reporting.texts import Texts
from rigs.errors import UseError

_LONGEST = 200
"""Characters of a field, as the name of an operator may have: a name fits, a page that was pasted does not."""


@dataclass(frozen=True)
class Heading:
    """What a person gives for the head of a report; a field that is empty is left out."""

    serial: str = ""
    customer: str = ""
    order: str = ""

    def check(self) -> None:
        """Raise UseError for a field that does not fit in one line of the page."""
        for name, text in vars(self).items():
            if len(text) > _LONGEST:
                raise UseError(f"--{name}", f"has {len(text)} characters", f"write at most {_LONGEST}")
            if not text.isprintable():
                raise UseError(f"--{name}", "holds control characters", "write it in one line")


NO_HEADING = Heading()


def fields_of(heading: Heading, results: Sequence[Result], texts: Texts) -> list[tuple[str, str]]:
    """Return the fields of the head as name and value: what was given, then what rig file and runs say.

    The serial number is that of the rig files of the runs where none is given, since the model may be of another robot.
    """
    serials = dict.fromkeys(result.measured.rig.robot.serial for result in results)
    operators = dict.fromkeys(result.measured.run.manifest.operator for result in results)
    fields = [
        ("serial", heading.serial or ", ".join(filter(None, serials))),
        ("customer", heading.customer),
        ("order", heading.order),
        ("operator", ", ".join(filter(None, operators))),
    ]
    return [(texts(name), value) for name, value in fields if value]
