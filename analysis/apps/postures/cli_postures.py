"""`rig postures TARGETS.csv`: which of the postures that reach each target has the smallest error."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from analysis.cli.commands import app, command
from analysis.cli.console import say, say_json, say_written
from analysis.cli.options import AsJson, Language, maker_option, rig_option
from rigs.errors import UseError
from rigs.schema.vocabulary import MakerName
from rigs.text import as_argument, numbers_in

if TYPE_CHECKING:
    from analysis.apps.postures.result import Postures
    from analysis.robot.kinematics.arm import Array
    from rigs.rig import Rig

_LEAST_PART_MM = 2.0
"""Lower bound of the longest side of a part. Chosen: 2 m, given in metres."""


@command(app, "rig postures targets.csv --rig found/cell.yaml -o postures")
def postures(
    targets: Annotated[
        Path,
        typer.Argument(
            metavar="TARGETS.csv",
            help="Targets in the order of the program: x_mm,y_mm,z_mm,rx_deg,ry_deg,rz_deg of the tool (roll-pitch-yaw "
            "about fixed axes, in the world frame of the rig file), or q1_deg … of the postures so far.",
        ),
    ],
    rig_file: Annotated[
        str,
        rig_option(
            "Calibrated rig file; or a rig file or an arm of the library that was not measured, with typical errors."
        ),
    ],
    part: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z",
            help="Size of the part in mm: also map where it could stand at this height; default: no map.",
        ),
    ] = None,
    change: Annotated[
        float,
        typer.Option(
            min=0.0,
            max=100.0,
            help="How strongly to avoid a change of configuration (elbow, wrist), relative to the mean error of a "
            "target: at 0.5 a change must halve the error of one target; 0 allows any change.",
        ),
    ] = 0.5,
    maker: Annotated[
        MakerName | None, maker_option("With -o: maker of the controller whose program is written", "none")
    ] = None,
    lang: Language = "en",
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="DIR", help="Directory for joint targets, tables and a picture; default: none."
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Rank all postures that reach each target by their expected error, and choose the best sequence.

    A posture is within the joint limits and clear of singularities. Obstacles are not known."""
    from analysis.apps.postures.report import answer_of
    from analysis.apps.postures.result import choose_postures
    from analysis.apps.postures.targets import labels_of, target_errors
    from analysis.apps.programs.target_path import read_targets
    from analysis.apps.report.blocks import say_answer
    from analysis.cli.console import progress_of
    from analysis.cli.several import end_with_errors
    from rigs.load import load, named_by

    size = _size_of(part)
    rig, _ = load(rig_file)
    _check_options(rig, maker, output, size)
    with named_by(rig_file, rig), progress_of("comparing postures"):
        read, poses, current = read_targets(targets, rig)
        chosen = choose_postures(rig, poses, current, change=change, part_mm=size)
        written: list[Path] = []
        if output is not None and len(chosen.best.rows):
            from analysis.apps.postures.files import write_postures  # matplotlib takes half a second

            written = write_postures(chosen, read, output, maker)
    if as_json:
        content = chosen.to_dict()
        of_lines = [target | {"line": line} for target, line in zip(content["targets"], read.lines, strict=True)]
        say_json(content | {"targets": of_lines, "files": [str(path) for path in written]})
    else:
        say_answer(answer_of(chosen, labels_of(read), lang))
    say_written(written)
    _say_next(rig_file, chosen, written)
    end_with_errors(target_errors(targets, read, chosen), " targets without a posture")


def _check_options(rig: Rig, maker: MakerName | None, output: Path | None, size: Array | None) -> None:
    if maker and not output:
        raise UseError("--for", "needs a directory to write to", "add -o DIR", code="postures.option")
    if maker and not rig.takes_programs:
        problem = "programs are written for arms of six axes without a rail"
        raise UseError("--for", problem, "leave it out and use postures.csv", code="postures.option")
    if size is not None and rig.robot.rail is not None:
        problem = "the map of places does not support an arm on a rail"
        raise UseError("--part", problem, "leave it out", code="postures.option")


def _size_of(part: str | None) -> Array | None:
    import numpy as np

    if part is None:
        return None
    size, remedy = np.array(numbers_in(part)), "give X,Y,Z in mm, such as 300,200,100"
    if size.shape != (3,) or (size < 0).any():
        raise UseError("--part", f"{part!r} is not a size", remedy, code="postures.part")
    if 0 < size.max() < _LEAST_PART_MM:
        problem = f"{part!r} has no side of {_LEAST_PART_MM:g} mm or more: the size looks like metres"
        raise UseError("--part", problem, remedy, code="postures.part")
    return size


def _say_next(rig_file: str, chosen: Postures, written: Sequence[Path]) -> None:
    rig = as_argument(rig_file)
    if written and chosen.knowledge == "calibrated":
        correct = f"rig correct {rig} --path {as_argument(written[0])} -o corrections"
        say(f"next: {correct}  # reduces the error further", err=True)
    elif chosen.knowledge == "typical" and not chosen.verdict:
        say(f"next: rig plan {rig} --poses 40 -o poses  # measure this arm", err=True)
