"""`rig check FILE`: whether a rig file is good."""

from __future__ import annotations

from analysis.cli import app
from analysis.cli.commands import command
from analysis.cli.console import say, say_error
from analysis.cli.options import RigArgument


@command(app, "rig check cell.yaml")
def check(
    rig_file: RigArgument,
) -> None:
    """Check a rig file: report every mistake with its line, and whether the robot can drive the tests."""
    import datetime as dt  # noqa: PLC0415

    from analysis.cli.several import end_with, worst  # noqa: PLC0415
    from analysis.geometry.feasible import feasible_tests  # noqa: PLC0415
    from analysis.noise.certificate import doubts_of  # noqa: PLC0415
    from analysis.reporting.origins import begins_with, in_calibration  # noqa: PLC0415
    from rigs.load import find, load  # noqa: PLC0415

    rig, _ = load(rig_file)
    tests, errors = feasible_tests(rig, rig_file)
    gauges = ", ".join(f"{name} {gauge.interface}" for name, gauge in rig.gauges.recorded.items())
    say(f"{find(rig_file)}: {'valid, but not all tests can be driven' if errors else 'good'}")
    read = f"{gauges}; robot by {rig.feedback.interface}" if gauges else "no gauges: for poses of a tracker"
    say(f"  {rig.robot.name}; {read}")
    if rig.effects:
        say(f"  the model starts with {begins_with(rig.effects)}")
    for line in in_calibration(rig.calibrated) if rig.calibrated else ():
        say(f"  {line}")
    parts = [*(name for name, _ in rig.gauges), "ball", "link"]
    for line in (*doubts_of(rig, parts, dt.datetime.now(dt.UTC).date()), *tests):
        say(f"  {line}")
    if rig.automatic:
        say(f"  recorded automatically: {', '.join(rule.event for rule in rig.automatic.rules)}")
    for error in errors:
        say_error(error)
    end_with(worst(errors))
