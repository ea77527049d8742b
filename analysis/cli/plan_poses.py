"""`rig plan RIG --poses N`: which poses a tracker measures, and the robot program that goes through them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from analysis.cli.console import say, say_json
from rigs.errors import FileError, UseError
from rigs.schema.vocabulary import MakerName

if TYPE_CHECKING:
    from analysis.geometry.pose_pool import Sight
    from analysis.inference.pose_plan import PlannedPoses
    from rigs.rig import Rig


def plan_poses(
    rig_file: str,
    count: int,
    output: Path | None,
    maker: MakerName | None,
    tracker: str | None,
    faces: str | None,
    dwell_s: float,
    *,
    one_axis: bool,
    as_json: bool,
) -> None:
    """Plan poses, say what they will show, and write them and their program where a directory is given."""
    from analysis.cli.progress import progress_of
    from analysis.inference.pose_plan import planned_poses
    from rigs.load import load, named_by

    if maker and not output:
        raise UseError("--for", "needs a directory to write to", "add -o DIR")
    rig, _ = load(rig_file)
    sight = _sight(tracker, faces)
    with named_by(rig_file, rig), progress_of("looking for poses"):
        planned = planned_poses(rig, count, sight, one_axis=one_axis)
    written = _write(rig, planned, output, maker, dwell_s) if output else []
    if as_json:
        say_json({**planned.to_dict(), "files": [str(path) for path in written]})
        return
    for line in planned.lines():
        say(line)
    for path in written:
        say(f"wrote {path}", err=True)
    if written:
        say("next: run the program at reduced speed, measure a row for each pose in order, and import them:", err=True)
        say(f"  rig import TRACKER.csv {written[0]} --join rows --rig {rig_file} --test pose -o runs/poses", err=True)


def _sight(tracker: str | None, faces: str | None) -> Sight | None:
    import numpy as np

    from analysis.geometry.pose_pool import Sight

    if tracker is None:
        if faces:
            raise UseError("--faces", "needs the place of the tracker", "add --tracker X,Y,Z")
        return None
    try:
        place = np.array([float(part) for part in tracker.split(",")])
    except ValueError:
        place = np.zeros(0)
    if place.shape != (3,) or not np.isfinite(place).all():
        raise UseError("--tracker", f"{tracker!r} is no place", "give X,Y,Z in mm, as 2500,0,800")
    axis = None
    if faces:
        axis = np.zeros(3)
        axis["xyz".index(faces[-1])] = -1.0 if faces.startswith("-") else 1.0
    return Sight(place, axis)


def _write(rig: Rig, planned: PlannedPoses, directory: Path, maker: MakerName | None, dwell_s: float) -> list[Path]:
    """The table of the poses, whose rows a tracker's are joined to, and the program."""
    from analysis.files.write import holding, write_all_new
    from analysis.makers.writing import encoded_programs, programs_of
    from analysis.robot_programs.examine import demand_of
    from analysis.robot_programs.planned import poses_plan

    files = {"poses.csv": holding(planned.csv().encode())}
    if maker:
        plan = poses_plan(rig, planned.q, dwell_s)
        files |= encoded_programs(maker, programs_of(maker, [(plan, demand_of(plan))]))
    try:
        return write_all_new(directory, files)
    except FileError as error:
        raise FileError(error.where, error.what, "give another --output") from None
