"""`rig check FILE`: whether a rig file is good."""

from __future__ import annotations

from analysis.cli import app
from analysis.cli.commands import command
from analysis.cli.console import say
from analysis.cli.options import RigArgument


@command(app, "rig check cell.yaml")
def check(
    rig_file: RigArgument,
) -> None:
    """Check a rig file: report every mistake with its line, and whether the robot can drive the tests."""
    import datetime as dt  # noqa: PLC0415

    from analysis.geometry.feasible import feasible_tests  # noqa: PLC0415
    from analysis.noise.certificate import doubts_of  # noqa: PLC0415
    from analysis.reporting.origins import begins_with  # noqa: PLC0415
    from rigs.load import find, load, named_by  # noqa: PLC0415

    rig, _ = load(rig_file)
    with named_by(rig_file, rig):
        tests = feasible_tests(rig)
    gauges = ", ".join(f"{name} {gauge.interface}" for name, gauge in rig.gauges.recorded.items())
    say(f"{find(rig_file)}: good")
    say(f"  {rig.robot.name}; {gauges}; robot by {rig.feedback.interface}")
    if rig.effects:
        say(f"  the model starts with {begins_with(rig.effects)}")
    parts = [*(name for name, _ in rig.gauges), "ball", "link"]
    for line in (*doubts_of(rig, parts, dt.datetime.now(dt.UTC).date()), *tests):
        say(f"  {line}")
    if rig.automatic:
        say(f"  recorded automatically: {', '.join(rule.event for rule in rig.automatic.rules)}")
