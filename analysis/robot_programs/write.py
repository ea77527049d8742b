"""Writing the programs of a test: which dialects there are, and files that are all new or not written at all."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from analysis.files.write import Writer, holding, write_all_new
from analysis.robot_programs import abb, fanuc, kuka, ur, yaskawa
from analysis.robot_programs.examine import Demand
from analysis.robot_programs.plan import Plan
from rigs.errors import FileError
from rigs.schema.feedback import ABBEGM, KUKARSI, URRTDE, FANUCStreamMotion, Feedback, LineFeed, ModbusJoints
from rigs.schema.vocabulary import Maker


@dataclass(frozen=True)
class Dialect:
    """write: the files of a plan by their names, lines ending with a line feed; newline: what the controller's files
    end lines with; outputs: the numbers of its digital outputs; feedbacks: the interfaces that this maker's controllers
    serve, and what they need for that."""

    write: Callable[[Plan, Demand], dict[str, str]]
    newline: str
    outputs: range
    feedbacks: Mapping[type, str]


_BY_ITSELF = "the controller serves it without the program"
_FROM_ONE = range(1, 4097)
"""Digital outputs count from 1; KUKA and Yaskawa have up to 4096, others fewer."""

DIALECTS: dict[Maker, Dialect] = {
    "ur": Dialect(ur.write, ur.NEWLINE, ur.OUTPUTS, {URRTDE: _BY_ITSELF, ModbusJoints: _BY_ITSELF}),
    "fanuc": Dialect(
        fanuc.write,
        fanuc.NEWLINE,
        _FROM_ONE,
        {
            LineFeed: "translate RIGFEED.KL and start it before the program",
            FANUCStreamMotion: _BY_ITSELF,
            ModbusJoints: _BY_ITSELF,
        },
    ),
    "kuka": Dialect(
        kuka.write,
        kuka.NEWLINE,
        _FROM_ONE,
        {KUKARSI: f"the program starts the RSI context {kuka.RSI_CONTEXT}, which you make", ModbusJoints: _BY_ITSELF},
    ),
    "abb": Dialect(
        abb.write,
        abb.NEWLINE,
        _FROM_ONE,
        {ABBEGM: "the program starts the stream to the UdpUc device rig, which you set up", ModbusJoints: _BY_ITSELF},
    ),
    "yaskawa": Dialect(yaskawa.write, yaskawa.NEWLINE, _FROM_ONE, {ModbusJoints: _BY_ITSELF}),
}


def feedback_note(maker: Maker, feedback: Feedback) -> str:
    """What the feedback of the rig file needs on a controller, in words."""
    need = DIALECTS[maker].feedbacks.get(type(feedback), "nothing in this program serves it; provide it yourself")
    return f"feedback {feedback.interface}: {need}"


def programs_of(maker: Maker, plans: Sequence[tuple[Plan, Demand]]) -> dict[str, str]:
    """The text of each file by its name; what several plans share is one file. Raises FileError where two plans would
    be one program, and for an output that the controller does not have."""
    files: dict[str, str] = {}
    outputs = DIALECTS[maker].outputs
    for plan, demand in plans:
        if unknown := [number for number in plan.signal_place.outputs if number not in outputs]:
            what = f"a controller of {maker} has no digital output {unknown[0]}"
            raise FileError(plan.name, what, f"give --outputs from {outputs.start} to {outputs.stop - 1}")
        for name, text in DIALECTS[maker].write(plan, demand).items():
            if files.setdefault(name, text) != text:
                raise FileError(name, "would hold two programs", "give the rig file a shorter name")
    return files


def write_programs(maker: Maker, files: dict[str, str], directory: Path) -> list[Path]:
    """Write the files into a directory, all of them or none. Raises FileError where one is there already."""
    return write_all_new(directory, encoded_programs(maker, files))


def encoded_programs(maker: Maker, files: dict[str, str]) -> dict[str, Writer]:
    """The writers of program files, with the line ends of their controller."""
    end = DIALECTS[maker].newline
    return {name: holding(text.replace("\n", end).encode("ascii")) for name, text in files.items()}
