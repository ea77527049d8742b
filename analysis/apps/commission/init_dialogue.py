"""Sequence of all questions of `rig init`.

Each answer is stored immediately, and the rig file is written atomically.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

from analysis.apps.commission.gauge_questions import ask_baseline, ask_gauges, check_baseline_mm
from analysis.apps.commission.init_answers import (
    Answers,
    Options,
    checked,
    forget_answers,
    keep_answers,
    kept_in,
    load_answers,
)
from analysis.apps.commission.rig_file_text import chosen_arm, rig_text
from analysis.apps.commission.robot_questions import (
    NO_ROBOT,
    ask_arm,
    ask_build,
    ask_circle,
    ask_robot,
    ask_robot_if_any,
    ask_tolerance,
    ask_tool,
    take_options,
)
from analysis.cli.dialogue import Dialogue
from daq.store import durable
from rigs.errors import CellError, FileError, UseError
from rigs.load import parse
from rigs.rig import Rig
from rigs.schema.vocabulary import MeasuredBy
from rigs.text import as_argument

_QUESTIONS: dict[MeasuredBy, tuple[Callable[[Answers, Options, Dialogue], Answers], ...]] = {
    "gauges": (ask_robot, ask_gauges, ask_baseline, ask_arm, ask_build, ask_tool, ask_tolerance),
    "sockets": (ask_arm, ask_build, ask_robot_if_any, ask_tool, take_options),
    "arm": (ask_arm, ask_build, ask_tool, take_options),
    "tracker": (ask_arm, ask_build, take_options),
}
"""Questions in order."""


def make_rig_file(options: Options, dialogue: Dialogue) -> None:
    """Ask all open questions and write the rig file.

    Raises FileError, CellError and Stopped; the answers remain stored.
    """
    path = options.path
    if not path.parent.is_dir():
        raise FileError(str(path.parent), "is not a directory", "create the directory, or choose a different name")
    _check_new(path)
    other = {"tracker": "a tracker", "arm": "a second arm"}.get(options.measured_by)
    if other and options.robot not in (None, NO_ROBOT):
        raise UseError("--robot", f"is not used with {other}: the table contains the joints", "remove it")
    gauges = {"--port": options.ports, "--g1, --g2": any(options.places), "--baseline-mm": options.baseline_mm}
    gauges |= {"--key": options.keys.get("g1") or options.keys.get("g2"), "--circle-here": options.circle_here}
    gauges |= {"--radius-mm": options.radius_mm}
    for option in (name for name, value in gauges.items() if value and options.measured_by != "gauges"):
        raise UseError(
            option, f"applies only to gauges, and --measured-by {options.measured_by} uses none", "remove it"
        )
    if options.baseline_mm is not None:
        check_baseline_mm(options.baseline_mm, "--baseline-mm")
    checked(Annotated[str, *Rig.model_fields["name"].metadata], options.name, "--name")
    if options.arm is not None:
        chosen_arm(options.arm, options.measured_by)
    answers = load_answers(path)
    if answers.count:
        dialogue.say(f"Continuing with the answers in {kept_in(path)}; remove the file to restart")
    for ask in _QUESTIONS[options.measured_by]:
        answers = ask(answers, options, dialogue)
        keep_answers(path, answers)
    if options.measured_by == "gauges":
        answers = ask_circle(answers, options, dialogue, _rig(answers, options)[0])
    _, text = _rig(answers, options)
    _check_new(path)
    try:
        durable.replace(path, text.encode())  # atomic, even after a power failure
    except OSError as error:
        problem = f"cannot be written: {error.strerror or error}"
        raise CellError(str(path), problem, "free some space; then repeat the command here") from None
    forget_answers(path)


def _check_new(path: Path) -> None:
    if path.exists() or path.is_symlink():
        raise FileError(
            str(path),
            "exists already",
            f"choose a different name, or edit the file and run rig check {as_argument(path)}",
        )


def _rig(answers: Answers, options: Options) -> tuple[Rig, str]:
    """Build the rig from the answers. Return it with the text of the rig file. Raises RigFileError."""
    assert answers.arm is not None  # noqa: S101 - asked for before
    arm, today = chosen_arm(answers.arm, options.measured_by), dt.datetime.now(dt.UTC).date()
    text = rig_text(answers, arm, options.name, today, options.measured_by)
    return parse(text, str(options.path)), text
