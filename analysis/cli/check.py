"""`rig check`, `rig example` and `rig interfaces`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from analysis.cli import completion
from analysis.cli.commands import app, command
from analysis.cli.console import say, say_error, say_json
from analysis.cli.options import AsJson, Calibration
from rigs.errors import FileError, UseError
from rigs.schema.controllers import practice_of
from rigs.text import counted, first_of

if TYPE_CHECKING:
    from analysis.runs.loading import Measured
    from rigs.calibration import CalibratedModel
    from rigs.effects import Effect
    from rigs.rig import Rig
    from rigs.schema.robot import Robot

_MOST_NAMED = 5
"""Maximum number of effects or runs that a line names."""


@command(app, "rig check cell.yaml")
def check(
    arguments: Annotated[
        list[str],
        typer.Argument(
            metavar="RIG|RUN…",
            autocompletion=completion.rig_files,
            help="Rig file, or the name of a shipped rig; or run directories of one robot, to check conventions.",
        ),
    ],
    calibration: Calibration = None,
    as_json: AsJson = False,
) -> None:
    """Check a rig file, or the labels of runs.

    For a rig file, report every mistake with its line, and tests that the robot
    cannot drive. For runs, report units, joints, gauges, times and places that
    contradict the labels.
    """
    runs = [Path(argument) for argument in arguments if Path(argument).is_dir()]
    if runs and len(runs) < len(arguments):
        not_a_run = next(argument for argument in arguments if not Path(argument).is_dir())
        remedy = "check a rig file by itself, or runs"
        raise UseError(not_a_run, "is not a directory with runs", remedy)
    if runs:
        _check_runs(runs, as_json=as_json)
        return
    if len(arguments) > 1 or as_json:
        remedy = "check one rig file at a time, without --json"
        raise UseError(arguments[0], "is not a directory with runs", remedy)
    _check_rig(arguments[0], calibration)


def _check_runs(paths: Sequence[Path], *, as_json: bool) -> None:
    from analysis.cli.several import end_with, over_runs, runs_below, worst_code
    from analysis.procedures.checks.check_runs import check_runs
    from analysis.runs.loading import load_measured

    runs: list[Measured] = []
    errors = over_runs(load_measured, runs_below(paths), runs.append, doing="reading")
    if not runs:
        end_with(worst_code(errors))
    checked = check_runs(runs)
    if as_json:
        names = [run.run.manifest.name for run in runs]
        say_json({"runs": names, "conventions": [convention.to_dict() for convention in checked]})
    else:
        for convention in checked:
            name = f"{convention.convention.name}:"
            for finding in convention.findings:
                where = f"{', '.join(finding.runs[:3])}{' …' * (len(finding.runs) > 3)}: " if len(runs) > 1 else ""
                say(f"{name:14}{where}{finding.words}")
            if not convention.findings:
                nothing = f"no problem found ({convention.convention.asks})"
                say(f"{name:14}{f'cannot be checked: {convention.cannot}' if convention.cannot else nothing}")
    contradicted = any(convention.findings for convention in checked)
    end_with(max(worst_code(errors), FileError.exit_code if contradicted else 0))


def _check_rig(rig_file: str, calibration: str | None) -> None:
    from analysis.cli.several import end_with, with_controller, worst_code
    from analysis.robot.geometry.driven_programs import feasible_tests
    from rigs.load import find, load
    from rigs.readiness import unmeasurable

    rig, _ = load(with_controller(rig_file, calibration))
    tests, undrivable = feasible_tests(rig, rig_file)
    lacks = [FileError(rig_file, lack.problem, lack.remedy, code="rig_file.invalid") for lack in unmeasurable(rig)]
    errors = [*lacks, *undrivable]
    say(f"{find(rig_file)}: {'valid, but not all tests can be driven' if errors else 'valid'}")
    unreachable = {error.where.rpartition("tests.")[2] for error in errors if "tests." in error.where}
    for line in _rig_lines(rig, tests, unreachable):
        say(f"  {line}")
    for error in errors:
        say_error(error)
    end_with(worst_code(errors))


def _rig_lines(rig: Rig, tests: Sequence[str], unreachable: set[str]) -> Iterator[str]:
    import datetime as dt

    from analysis.runs.noise.certificate import doubts_of
    from rigs.readiness import readiness_lines
    from rigs.schema.feedback import NoFeedback

    gauges = ", ".join(f"{name} {gauge.interface}" for name, gauge in rig.gauges.recorded.items())
    places = "touching sockets" if rig.tests.touch else "a tracker"
    robot = "" if isinstance(rig.feedback, NoFeedback) else f"; robot by {rig.feedback.interface}"
    yield f"{rig.robot.name}; {gauges or f'no gauges; measured by {places}'}{robot}"
    yield from filter(None, [controller_line(rig)])
    if rig.controller_doubt:
        yield f"doubt: {rig.controller_doubt}"
    if rig.effects:
        yield f"the model already contains {initial_effects(rig.effects)}"
    yield from calibration_lines(rig.calibrated) if rig.calibrated else ()
    yield from _doubtful_geometry(rig.robot)
    yield from doubts_of(rig, [*(name for name, _ in rig.gauges), "ball", "link"], dt.datetime.now(dt.UTC).date())
    yield from tests
    yield from readiness_lines(rig, unreachable)
    if rig.automatic:
        yield f"recorded automatically: {', '.join(rule.event for rule in rig.automatic.rules)}"


def initial_effects(effects: Sequence[Effect]) -> str:
    """Effects that a model contains initially: `2 effects, written by hand: …`."""
    from rigs.effect_names import name_in_words
    from rigs.schema.effect import name_of

    origins: dict[str, list[str]] = {}
    for effect in effects:
        origin = (
            "written by hand"
            if effect.found is None
            else f"found on {effect.found.date} in {first_of(effect.found.runs, _MOST_NAMED)}"
        )
        origins.setdefault(origin, []).append(name_in_words(name_of(effect)))
    listed = "; ".join(f"{origin}: {first_of(names, _MOST_NAMED)}" for origin, names in origins.items())
    return f"{counted(len(effects), 'effect')}, {listed}"


def controller_line(rig: Rig) -> str:
    """Line on a controller that may have constants of its own; empty if the rig file states it."""
    practice = practice_of(rig.maker or rig.robot.name)
    if rig.controller != "unknown" or practice is None:
        return ""
    if practice.own_constants == "always":
        has, how = "has constants of its own", "or five rows of joints and flange pose from the pendant (tool: none)"
    else:
        has = "may have constants of its own, an option of the maker"
        how = "(tool: none; five rows show whether it has any)"
    without = "until then targets given as poses are not corrected"
    return f"the controller {has}: give {practice.get} {how}, with the option --calibration; {without}"


def calibration_lines(model: CalibratedModel) -> list[str]:
    runs = first_of([run.name for run in model.runs], _MOST_NAMED)
    accuracy = f"error in its runs {model.before_um:.0f} µm rms, with the calibration {model.calibrated_um:.0f} µm"
    if model.held_out_um is not None:
        accuracy += f" ({model.held_out_um:.0f} µm in readings not used to fit it)"
    if model.widened > 1:
        accuracy += (
            f"; the uncertainty was increased {model.widened:.2g} times, because these readings required it or are few"
        )
    joints = ", ".join(f"{axis}: {low:z.0f}° to {high:z.0f}°" for axis, (low, high) in enumerate(model.joints_deg, 1))
    return [
        f"calibrated on {model.date} from {runs}: {len(model.terms)} terms; {accuracy}",
        f"valid for these joint angles, axis by axis: {joints}; outside, typical errors are assumed",
    ]


def _doubtful_geometry(robot: Robot) -> Iterator[str]:
    """Doubts about lengths that may be in metres and that no arm of the library has, and about coupled axes."""
    from rigs.arms import arm_files, load_arm
    from rigs.named_arm import named_arm_doubts
    from rigs.schema.unit_checks import SLOWEST_DEG_S

    yield from (f"doubt: {doubt}" for doubt in named_arm_doubts(robot))
    if (fastest := max(axis.speed_deg_s for axis in robot.axes)) < SLOWEST_DEG_S:
        yield f"doubt: no axis is faster than {fastest:g}°/s; if speed_deg_s is in rad/s, multiply it by 57.2958"
    if lengths := list(robot.short_lengths()):
        known = {value for name in arm_files() for *_, value in load_arm(name).robot.short_lengths()}
        for axis, key, value in (one for one in lengths if one[2] not in known):
            in_mm = f"if it is in metres, multiply it by 1000: {1000 * value:g}"
            yield f"doubt: {robot.axis_words(axis)}: {key} is only {value:g}; {in_mm}"
    if robot.drives is None and robot.drive_ratios != robot.coupling:
        yield (
            "doubt: robot.coupling relates several axes, and robot.drives is missing: each drive is assumed to turn "
            "its own axis only, as in a serial arm; if a linkage couples them (palletiser), add drives"
        )


@command(app, "rig example rigs")
def example(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Directory for the files, created if missing.")],
) -> None:
    """Copy the shipped rig files, and the hidden effects of their emulated cells, to a directory."""
    from analysis.runs.written_files import holding, write_all_new
    from rigs.load import shipped, shipped_effects

    sources = [*shipped().values(), *shipped_effects().values()]
    for path in write_all_new(folder, {source.name: holding(source.read_bytes()) for source in sources}):
        say(str(path))


@command(app, "rig interfaces")
def interfaces(as_json: AsJson = False) -> None:
    """List the gauge and robot interfaces with instruments, line settings, protocol source and open questions."""
    from dataclasses import asdict

    from analysis.cli.listings import interfaces_table
    from analysis.cli.plain_console import PlainConsole
    from rigs.interfaces import list_interfaces

    drivers = list_interfaces()
    if as_json:
        say_json({"interfaces": [asdict(driver) for driver in drivers]})
    else:
        PlainConsole().print(interfaces_table(drivers))
