"""The one error tree: every expected failure is a `RigError`, reported in one line with an exit code.

A message says where, what and what to do. Programs print it and leave with `exit_code`;
anything else that reaches a person as a traceback is a bug.
"""

from __future__ import annotations

import re
from typing import Any, Literal

from rigs.text import plain

_LONGEST = 1000
Undrivable = Literal["limits", "speed", "singularity", "reach"]
"""Why an arm cannot drive a path: a joint's limits or speed, a singularity, or its reach."""


class RigPlace(str):
    """A rig, or the part of it that is wrong, where an error is about a rig whose file is not known: code that has only
    the rig names it by the rig's own name, which copies of a file share. part: as `tests.circle`, or nothing."""

    rig_name: str = ""
    part: str = ""

    @classmethod
    def of(cls, rig_name: str, part: str = "") -> RigPlace:
        place = cls(f"{rig_name}, {part}" if part else rig_name)
        place.rig_name, place.part = rig_name, part
        return place


class RigError(Exception):
    """An expected failure.

    where: the thing it happened to (a file, a port, a gauge); what: what is wrong;
    remedy: what a person should do about it.
    """

    exit_code = 1

    def __init__(self, where: str, what: str, remedy: str) -> None:
        # A message as a line can bear it, whatever a damaged file has put into it; its end says what to do.
        text = f"{where}: {what}; {remedy}"
        if len(text) > _LONGEST:
            text = f"{text[: _LONGEST // 2]} … {text[-_LONGEST // 2 :]}"
        super().__init__(plain(text))
        self.where, self.what, self.remedy = where, what, remedy

    def __reduce__(self) -> tuple[Any, ...]:
        """How it crosses to another process: constructors of subclasses take other arguments than `Exception` keeps."""
        return _again, (type(self), self.args), self.__dict__

    def lines(self) -> list[str]:
        """The message: one line for each mistake."""
        return [str(self)]


def _again(kind: type[RigError], args: tuple[Any, ...]) -> RigError:
    return kind.__new__(kind, *args)


class UseError(RigError):
    """A command is used in a way that it does not offer: options that exclude each other, an impossible value."""

    exit_code = 2


class FileError(RigError):
    """A rig file, a run or a table is missing, damaged or wrong."""

    exit_code = 3


class PathError(FileError):
    """An arm cannot drive a path that a rig file states. reason: what stands in its way, by which code decides."""

    def __init__(self, where: str, what: str, remedy: str, reason: Undrivable) -> None:
        super().__init__(where, what, remedy)
        self.reason = reason


class DirectionError(FileError):
    """A circle was driven in the other direction than its run is labelled with. drove: the direction it was driven."""

    def __init__(self, where: str, what: str, remedy: str, drove: Literal["cw", "acw"]) -> None:
        super().__init__(where, what, remedy)
        self.drove = drove


class CellError(RigError):
    """The cell does not answer as it should: a port, a gauge, the robot, the daemon."""

    exit_code = 4


_IN_WORDS_OF_PYDANTIC = re.compile(r"Value error, |, unable to parse string as an? \w+$")
"""What pydantic, by which typer reads values, says of how it found a mistake."""


def wrong_use(error: Any, program: str) -> UseError | None:
    """Return the error of a person who typed what typer refuses (a TyperException); None for a group of commands
    without a command, whose help is printed already."""
    message = _IN_WORDS_OF_PYDANTIC.sub("", " ".join(error.format_message().split()).rstrip("."))
    message = message.replace("Input should be", "it must be")
    if not message:
        return None
    context = getattr(error, "ctx", None)
    command = context.command_path if context is not None else program
    return UseError(command, message, f"see {command} --help")
