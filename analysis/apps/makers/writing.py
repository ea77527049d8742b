"""Writing the programs of a test: either all files are new, or none is written."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from analysis.apps.makers import maker_by
from analysis.apps.makers.motion_plan import Demand, MotionPlan
from analysis.apps.makers.program_writer import BY_ITSELF
from analysis.runs.written_files import Writer, holding, write_all_new
from rigs.errors import FileError
from rigs.schema.feedback import Feedback, ModbusJoints
from rigs.schema.vocabulary import MakerName


def feedback_note(maker: MakerName, feedback: Feedback) -> str:
    served = {ModbusJoints: BY_ITSELF} | dict(maker_by(maker).writer.feedbacks)
    need = served.get(type(feedback), "provide it yourself: this program does not")
    return f"feedback {feedback.interface}: {need}"


def programs_of(maker: MakerName, plans: Sequence[tuple[MotionPlan, Demand]]) -> dict[str, str]:
    """Write the text of each file by name.

    Raises FileError if two plans have the same program name, and for an output that the controller lacks.
    """
    files: dict[str, str] = {}
    writer = maker_by(maker).writer
    outputs = writer.outputs
    for plan, demand in plans:
        if unknown := [number for number in plan.signal_place.outputs if number not in outputs]:
            problem = f"digital output {unknown[0]} does not exist on a {maker} controller"
            remedy = f"give --outputs from {outputs.start} to {outputs.stop - 1}"
            raise FileError(plan.name, problem, remedy, code="output.invalid")
        for name, text in writer.write(plan, demand).items():
            if files.setdefault(name, text) != text:
                remedy = "give the rig file a shorter name"
                raise FileError(name, "would contain two programs", remedy, code="output.invalid")
    return files


def write_programs(maker: MakerName, files: dict[str, str], directory: Path) -> list[Path]:
    """Write the files into a directory, all or none. Raises FileError if a file already exists."""
    return write_all_new(directory, encoded_programs(maker, files))


def encoded_programs(maker: MakerName, files: dict[str, str]) -> dict[str, Writer]:
    end = maker_by(maker).writer.newline
    return {name: holding(text.replace("\n", end).encode("ascii")) for name, text in files.items()}
