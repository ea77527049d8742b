"""Detection of a robot by RTDE, by lines printed to a port, or by a controller that contacts a local port.

The address alone determines the data sent: RTDE read requests to port 30004, FANUC Stream Motion status requests to
port 60015, OPC UA browse and read requests to port 4840. At other ports rig only listens: unexpected bytes can stop the
serving program, and the script ports of Universal Robots execute them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

from pydantic import ValidationError

from daq import clock, feedback
from daq.acquisition.stream_buffer import faults_of
from daq.acquisition.streams import ROBOT, robot_stream
from daq.discovery.attempts import Probing, RobotReport, Sends
from daq.discovery.cell_finding import condition_in, stop_reason
from daq.discovery.trial import ACCEPTED, OF_THE_INSTRUMENT, Trial, describe_silence, try_line
from daq.protocol.conversation import Arrival, Fault, FaultKind
from daq.protocol.framing import DelimitedLines, Message
from daq.protocol.numerals import number
from daq.wire.links import LinkLost, open_link
from rigs.errors import CellError
from rigs.schema.feedback import (
    ABBEGM,
    KUKARSI,
    LINUXCNC_PORT,
    URRTDE,
    FANUCStreamMotion,
    Feedback,
    LineFeed,
    LinuxCNC,
    OPCUARobotics,
)
from rigs.schema.links import tcp_address, udp_address

_SEPARATORS = (",", ";", " ")
_FEWEST_LINES = 5
_CLOCKS = {"t_s": 1.0, "t_ms": 1e3, "t_us": 1e6}
_PACE = 0.25
"""Allowed relative difference between a clock and the host clock over half a second of lines."""


@dataclass(frozen=True)
class LineLayout:
    fields: tuple[str, ...]
    separator: str
    sure: bool


def layout_of(arrivals: Sequence[Arrival]) -> LineLayout | None:
    """Separator, clock and six angles of received lines by their numbers; None for lines with fewer than six.

    Degrees are sure if an angle is larger than a full turn in radians.
    """
    frames = DelimitedLines(b"\n", joined_midway=True)
    lines = [
        (message.data.decode("ascii", "replace").strip(), message.last_byte_ns / 1e9)
        for data, at_ns in arrivals
        for message in frames.feed(data, at_ns)
        if isinstance(message, Message)
    ]
    for separator in _SEPARATORS:
        split = (text.split(None if separator == " " else separator) for text, _ in lines)
        rows = [[number(part.strip()) for part in parts] for parts in split]
        if len(rows) >= _FEWEST_LINES and len(rows[0]) >= 6 and len({len(row) for row in rows}) == 1:
            break
    else:
        return None
    columns = [list(column) for column in zip(*rows, strict=True)]
    at_s = [at_s for _, at_s in lines]
    clocks = [(place, name) for place, column in enumerate(columns) if (name := _clock(column, at_s))]
    names = dict(clocks[:1])
    joints = [place for place, column in enumerate(columns) if place not in names and None not in column][:6]
    if len(joints) < 6:
        return None
    largest = max(abs(value) for place in joints for value in columns[place] if value is not None)
    names |= {place: f"q{axis}_deg" for axis, place in enumerate(joints, 1)}
    fields = tuple(names.get(place, "_") for place in range(len(columns)))
    return LineLayout(fields, separator, largest > 2 * math.pi)


def _clock(column: list[float | None], at_s: list[float]) -> str | None:
    """Name of the clock in a column that grows at the pace of the host clock."""
    lasted_s = at_s[-1] - at_s[0]
    values = [value for value in column if value is not None]
    rises = len(values) == len(column) and all(b >= a for a, b in pairwise(values))
    if not rises or lasted_s <= 0:
        return None
    pace = (values[-1] - values[0]) / lasted_s
    return next((name for name, rate in _CLOCKS.items() if abs(pace / rate - 1) < _PACE), None)


_LISTEN_S = 1.5
_SILENCES = 3
"""Number of time-outs in each attempt: a request datagram may be lost."""
_CONFIRM_S = 0.5
_PATIENCE_S = 3.0
_RTDE, _STREAM_MOTION, _OPC_UA = 30004, 60015, 4840
"""Ports of RTDE (Universal Robots), Stream Motion (FANUC) and OPC UA."""
_RATES_HZ = (500.0, 125.0)
"""RTDE rates of the e-Series and the CB3."""
_CYCLES_MS: tuple[Literal[4, 12], ...] = (4, 12)


@dataclass(frozen=True)
class _Tried:
    feedback: Feedback
    trial: Trial
    sure: bool = True
    """The angle unit is certain."""


def linuxcnc_port(address: str) -> str | None:
    """`tcp://host:port` of `linuxcnc://host` or `linuxcnc://host:port`; None for other addresses."""
    scheme, _, host = address.partition("linuxcnc://")
    if scheme or not host:
        return None
    return f"tcp://{host}" if re.search(r":\d+$", host) else f"tcp://{host}:{LINUXCNC_PORT}"


def search_robot(address: str, named: Feedback | None = None) -> RobotReport:
    """Search for a robot at an address (`rig init --help`). named: interface given by the user; no other is tried."""
    failed: list[str] = []
    answers = False
    try:
        for tried in _try_interfaces(address) if named is None else [_try(named)]:
            trial = tried.trial
            if trial.evidence[0] or (named and trial.samples):
                last = trial.samples[-1]
                stopped = stop_reason(condition_in(robot_stream(tried.feedback).columns, last))
                reported = stopped or _own_report(trial)
                return RobotReport(address, tried.feedback, last.values[:6], trial.rate_hz, tried.sure, reported)
            quiet = describe_silence(tried.feedback.port, trial)
            answers |= quiet == ACCEPTED
            silence = "sends data in an unknown format" if trial.received else quiet
            why = trial.error.what if trial.error else _own_report(trial) or silence
            failed.append(f"{tried.feedback.interface} on {tried.feedback.port}: {why}")
    except ValidationError:
        remedy = "give HOST, tcp://HOST:PORT or udp://ADDRESS:PORT"
        return RobotReport(address, problem="is not an address", remedy=remedy)
    load = "load rig.hal in LinuxCNC, start it and home all joints (docs/linuxcnc.md)"
    remedy = load if linuxcnc_port(address) else _remedy(address, named, answers=answers)
    return RobotReport(address, problem="; ".join(dict.fromkeys(failed)), remedy=remedy)


def joints_of(robot: Feedback) -> tuple[float, ...]:
    trial = _try(robot).trial
    if trial.error:
        raise trial.error
    if not trial.samples:
        remedy = trial.last_fault or "check that it is on and the program runs"
        raise CellError(robot.port, "reports no joint angles", remedy, code="robot.silent")
    return trial.samples[-1].values[:6]


def _try_interfaces(address: str) -> Iterator[_Tried]:
    tcp, udp = tcp_address(address), udp_address(address)
    if port := linuxcnc_port(address):
        yield _try(LinuxCNC(interface="linuxcnc", port=port))
    elif udp and udp[1] == _STREAM_MOTION:
        yield _try(FANUCStreamMotion(interface="fanuc_stream_motion", port=address))
    elif udp:
        for cycle_ms in _CYCLES_MS:
            yield _try(KUKARSI(interface="kuka_rsi", port=address, cycle_ms=cycle_ms))
        yield _try(ABBEGM(interface="abb_egm", port=address))
    elif tcp and tcp[1] == _OPC_UA:
        yield _try(OPCUARobotics(interface="opc_ua_robotics", port=address))
    elif address.startswith("/") or (tcp and tcp[1] != _RTDE):
        yield _try_line_feed(address)
    else:
        port = address if tcp else f"tcp://{address}:{_RTDE}"
        for rate_hz in _RATES_HZ:
            yield _try(URRTDE(interface="ur_rtde", port=port, rate_hz=rate_hz))


def _try_line_feed(address: str) -> _Tried:
    """Listen to lines and guess the layout, over a single connection, because some programs end with it."""
    plain = LineFeed(interface="line_feed", port=address)
    try:
        link = open_link(ROBOT, address, plain.line)
    except CellError as error:
        return _Tried(plain, Trial(error=error))
    try:
        arrivals, until_s = list[Arrival](), clock.now_s() + _LISTEN_S
        while (left_s := until_s - clock.now_s()) > 0:
            if data := link.read(left_s):
                arrivals.append((data, clock.now_ns()))
    except LinkLost as lost:
        return _Tried(plain, Trial([Fault(FaultKind.DISCONNECTED, clock.now_ns(), str(lost))]))
    finally:
        link.close()
    layout = layout_of(arrivals)
    fields = {"fields": layout.fields, "separator": layout.separator} if layout else {}
    read = plain.model_copy(update=fields)
    host = feedback.host(read)
    items = [item for data, at_ns in arrivals for item in host.received(data, at_ns).items]
    received = sum(len(data) for data, _ in arrivals)
    return _Tried(read, Trial(items, _LISTEN_S, received, received), sure=layout is None or layout.sure)


def _try(robot: Feedback) -> _Tried:
    """Run a conversation briefly. A controller that contacts this computer is only listened to."""
    # Without expected responses, RSI receives none.
    limits = {"timeout_s": _LISTEN_S / _SILENCES} | ({"onlysend": True} if robot.interface == "kuka_rsi" else {})
    tried = robot.model_copy(update=limits)
    sends: Sends = "nothing" if robot.listens else "all"
    stream = replace(robot_stream(tried), host=lambda: Probing(feedback.host(tried), sends, _SILENCES))
    return _Tried(robot, try_line(stream, stream.line, _PATIENCE_S, _CONFIRM_S))


def _own_report(trial: Trial) -> str:
    """Last report of the controller: a warning, a refusal, or a missing feature."""
    reports = [fault.detail for fault in faults_of(trial.items) if fault.kind in OF_THE_INSTRUMENT]
    return reports[-1] if reports else ""


def _remedy(address: str, named: Feedback | None, *, answers: bool) -> str:
    """answers: the connection is accepted."""
    tcp, udp = tcp_address(address), udp_address(address)
    if named is not None and named.interface != "line_feed":
        return f"check that {named.interface} is available at this address and allowed in the controller's settings"
    if udp and udp[1] == _STREAM_MOTION:
        return "check the address, the cable, and that the controller has option J519"
    if udp:
        return "start the sending program (RSI_ON, EGMStreamStart), with the address and port of this computer"
    if tcp and tcp[1] == _OPC_UA:
        return "switch the OPC UA server on, and allow anonymous reading without encryption"
    if tcp and tcp[1] != _RTDE:
        return (
            "start the sending program; for a Universal Robots arm give only the host, or --key "
            "feedback.interface=ur_rtde if RTDE uses this port; rig interfaces lists the others"
        )
    first = "allow RTDE in the settings (Security, Services)" if answers else "switch it on"
    return (
        f"{first}; for RTDE on a different port give tcp://HOST:PORT and --key feedback.interface=ur_rtde; "
        "for a program that prints lines tcp://HOST:PORT; for FANUC's Stream Motion udp://HOST:60015; and "
        "for a controller that connects to this computer (KUKA RSI, ABB EGM) udp://ADDRESS:PORT"
    )
