"""Exceptions: every expected failure is a `RigError`, reported in a single line with an exit code.

A message contains the affected object, the problem and the remedy. Programs print it and exit with `exit_code`; with
`--json` they print `RigError.to_dict`. Scripts and tests compare `code`, never the text; `rigs/error_codes.py` lists
all codes. Any other traceback shown to a user is a bug.
"""

from __future__ import annotations

import copyreg
import re
from typing import Any, Literal, Self

from rigs.text import escape_text

_LONGEST = 1000
Undrivable = Literal["limits", "speed", "singularity", "reach"]
"""Reason for an arm that cannot follow a path: joint limits, joint speed, a singularity, or the reach."""


class RigPlace(str):
    """Name of a rig, used in errors if the file is unknown. part: for example `tests.circle`, or empty."""

    rig_name: str = ""
    part: str = ""

    @classmethod
    def of(cls, rig_name: str, part: str = "") -> RigPlace:
        place = cls(f"{rig_name}, {part}" if part else rig_name)
        place.rig_name, place.part = rig_name, part
        return place


class RigError(Exception):
    """Base of all expected failures.

    where: affected object (file, port, gauge).
    what: description of the problem.
    remedy: action for the user.
    code: what a script can do about it, one of `ERROR_CODES`; without one that of the class.

    Example:

        try:
            run = load_run("runs/monday-acw")
        except RigError as error:
            print(error.code, error.where, error.what, error.remedy)
    """

    exit_code = 1
    code = "rig"

    def __init__(self, where: str, what: str, remedy: str, code: str = "") -> None:
        # Printable in a single line, for any content of a damaged file. The remedy comes last.
        text = f"{where}: {what}; {remedy}"
        if len(text) > _LONGEST:
            text = f"{text[: _LONGEST // 2]} … {text[-_LONGEST // 2 :]}"
        super().__init__(escape_text(text))
        self.where, self.what, self.remedy = where, what, remedy
        if code:
            self.code = code

    @classmethod
    def of_os(cls, where: object, error: OSError, remedy: str, code: str) -> Self:
        """A failure in the words of the operating system."""
        return cls(str(where), error.strerror or str(error), remedy, code)

    def __reduce__(self) -> tuple[Any, ...]:
        # Constructors of subclasses have arguments other than those stored by `Exception`.
        return copyreg.__newobj__, (type(self), *self.args), self.__dict__  # type: ignore[attr-defined] # untyped

    def lines(self) -> list[str]:
        """A line per problem."""
        return [str(self)]

    def to_dict(self) -> dict[str, Any]:
        """The error as plain types for JSON."""
        names = ("code", "where", "what", "remedy", "exit_code")
        return {name: getattr(self, name) for name in names}


class UseError(RigError):
    """Wrong use of a command, such as conflicting options or an impossible value."""

    exit_code = 2
    code = "usage"


class FileError(RigError):
    """A rig file, run or table is missing, damaged or wrong. A subclass of RigError."""

    exit_code = 3
    code = "file"


class PathError(FileError):
    """An arm cannot follow a path of a rig file. reason: obstacle, for decisions in code."""

    def __init__(self, where: str, what: str, remedy: str, reason: Undrivable) -> None:
        super().__init__(where, what, remedy, code="path.impossible")
        self.reason = reason


class DirectionError(FileError):
    """A circle was driven against the direction in the label. drove: actual direction."""

    def __init__(self, where: str, what: str, remedy: str, drove: Literal["cw", "acw"]) -> None:
        super().__init__(where, what, remedy, code="readings.unsuitable")
        self.drove = drove


class CellError(RigError):
    """The cell does not respond as expected: a port, gauge, robot or daemon. A subclass of RigError."""

    exit_code = 4
    code = "cell"


_IN_WORDS_OF_PYDANTIC = re.compile(r"Value error, |, unable to parse string as an? \w+$")


def wrong_use(error: Any, program: str) -> UseError | None:
    """Error for input refused by typer (a TyperException); None for a group that has printed its help."""
    message = _IN_WORDS_OF_PYDANTIC.sub("", " ".join(error.format_message().split()).rstrip("."))
    message = message.replace("Input should be", "it must be")
    if not message:
        return None
    context = getattr(error, "ctx", None)
    command = context.command_path if context is not None else program
    return UseError(command, message, f"see {command} --help")
