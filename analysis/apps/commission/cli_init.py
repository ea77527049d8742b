"""`rig init`: a rig file from connected devices and the answers of the user."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from analysis.cli.check import check
from analysis.cli.commands import app, command
from analysis.cli.console import INTERRUPTED, progress_of, say, say_json
from analysis.cli.options import Calibration
from rigs.schema.vocabulary import Build, MeasuredBy

if TYPE_CHECKING:
    from analysis.apps.commission.init_answers import Options


@command(app, "rig init cell.yaml --robot 192.168.1.20 --arm ur10e")
def init(
    rig_file: Annotated[Path, typer.Argument(metavar="RIG", help="Rig file to write.")] = Path("cell.yaml"),
    name: Annotated[str | None, typer.Option(help="Name of the rig; default: the name of the file.")] = None,
    measured_by: Annotated[
        MeasuredBy,
        typer.Option(
            help="Instrument: gauges and a ball link, poses of a tracker, a ball in sockets, or a second arm with "
            "the socket; for arms of four, five and seven axes not gauges."
        ),
    ] = "gauges",
    robot: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Host of the robot, tcp://host:port, udp://address:port or linuxcnc://host; for sockets also none "
            "(typed joints); default: interactive.",
        ),
    ] = None,
    port: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PORT", help="Serial port or tcp://host:port of a gauge; repeatable; default: interactive."
        ),
    ] = None,
    g1: Annotated[
        str | None, typer.Option(metavar="PORT", help="Port of gauge 1, PORT#CHANNEL if shared; default: interactive.")
    ] = None,
    g2: Annotated[
        str | None, typer.Option(metavar="PORT", help="Port of gauge 2, PORT#CHANNEL if shared; default: interactive.")
    ] = None,
    key: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=VALUE", help="Key of the rig file, such as g1.range_mm=10; repeatable; default: none."
        ),
    ] = None,
    baseline_mm: Annotated[
        float | None, typer.Option(min=0.1, max=10_000, help="Distance between the gauges in mm; default: interactive.")
    ] = None,
    arm: Annotated[
        str | None, typer.Option(help="Arm by name, or a file with a section robot; default: interactive.")
    ] = None,
    calibration: Calibration = None,
    build: Annotated[
        Build | None,
        typer.Option(help="Build of the arm; default: that of the library or the file, otherwise interactive."),
    ] = None,
    tool: Annotated[
        str | None,
        typer.Option(
            metavar="POSE",
            help="Ball on the flange: x,y,z in mm, then roll,pitch,yaw in degrees; default: interactive.",
        ),
    ] = None,
    tolerance_mm: Annotated[
        float | None,
        typer.Option(min=0, max=1000, help="Allowed error at the ball in mm, 0 for unlimited; default: interactive."),
    ] = None,
    circle_here: Annotated[
        bool | None,
        typer.Option("--circle-here/--circle-later", help="State that the robot is at the start of the circle."),
    ] = None,
    radius_mm: Annotated[float | None, typer.Option(min=1, max=2000, help="Circle radius, mm; default: 70.")] = None,
    listen_s: Annotated[
        float, typer.Option(min=0.2, max=60, help="Seconds to listen to a port before rig sends a request.")
    ] = 1.0,
    modbus_unit: Annotated[
        list[int] | None, typer.Option(min=0, max=247, help="Modbus unit address to query; repeatable; default: 1.")
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the result as one JSON object without writing a file.")
    ] = False,
) -> None:
    """Find gauges and robot, identify each, and write a checked rig file.

    rig init only reads, and opens only the ports that you name. It listens
    first, then sends the read request of each protocol. Answers are saved next
    to the rig file until the file is written, so an interrupted rig init can
    continue. Without a terminal, answer each question with an option.
    """
    from analysis.apps.commission.init_answers import Options, keys_of, places_of

    keys = keys_of(key or ())
    answered = {"baseline_mm": baseline_mm, "arm": arm, "build": build, "tool": tool, "tolerance_mm": tolerance_mm}
    given = {key: value for key, value in answered.items() if value is not None}
    name = name or re.sub(r"[^a-z0-9_-]+", "-", rig_file.stem.lower()).strip("-_")[:63] or "cell"
    options = Options(
        path=rig_file, name=name, measured_by=measured_by, robot=robot, ports=tuple(port or ()),
        places=places_of(g1, g2, keys), keys=keys, given=given, circle_here=circle_here, radius_mm=radius_mm,
        listen_s=listen_s, modbus_units=tuple(modbus_unit or (1,)),
    )  # fmt: skip
    if as_json:
        _say_devices(options)
        return
    _make(options)
    if calibration:
        _add_calibration(rig_file, calibration)
    check([str(rig_file)])
    say("next:")
    for line in next_steps(rig_file, measured_by):
        say(f"  {line}")


def _say_devices(options: Options) -> None:
    from analysis.apps.commission.gauge_questions import ports_of, reports_of
    from analysis.apps.commission.questionnaire import NO_ROBOT, robot_at
    from daq.discovery.port_search import ports_here

    address = options.robot if options.robot != NO_ROBOT else None
    robots = [robot_at(address, options.keys["feedback"]).to_dict()] if address else []
    with progress_of("looking at the ports") as doing:
        ports = [report.to_dict() for report in reports_of(ports_of(options), options, doing)]
    say_json({"ports_here": ports_here(), "ports": ports, "robots": robots})


def _make(options: Options) -> None:
    from analysis.apps.commission.init_answers import kept_in
    from analysis.apps.commission.questionnaire import make_rig_file
    from analysis.cli.dialogue import DialogueEnded, at_terminal

    try:
        make_rig_file(options, at_terminal(say, progress_of))
    except (KeyboardInterrupt, DialogueEnded):
        say("")
        kept, outcome = kept_in(options.path), "no file was written"
        if kept.exists():
            outcome = f"repeat the command to continue with the answers in {kept}"
        say(f"stopped; {outcome}", err=True)
        raise typer.Exit(INTERRUPTED) from None


def _add_calibration(rig_file: Path, calibration: str) -> None:
    from analysis.intake.controller_arm import rig_with_controller
    from analysis.runs.written_files import holding, write_all_over
    from rigs.load import load

    _, text, read = rig_with_controller(*load(rig_file), calibration)
    write_all_over(rig_file.parent, {rig_file.name: holding(text.encode())})
    say(read.words)


def next_steps(rig_file: Path, measured_by: MeasuredBy) -> list[str]:
    from analysis.apps.commission.rig_file_text import rendered
    from rigs.load import load
    from rigs.schema.feedback import NoFeedback

    rig, _ = load(rig_file)
    file, other = (shlex.quote(str(path)) for path in (rig_file, rig_file.with_name("other.yaml")))
    is_typed = isinstance(rig.feedback, NoFeedback)
    return rendered("next_steps", rig=rig, by=measured_by, file=file, other=other, is_typed=is_typed).splitlines()
