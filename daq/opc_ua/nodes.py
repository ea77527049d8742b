"""Search for a robot in the address space of an OPC UA server by the browse names of OPC 40010-1.

The condition of the robot is mapped to the columns and codes of `rigs.schema.condition`.

    Objects / DeviceSet / <system> / MotionDevices / <robot> / Axes / <axis> / ParameterSet / ActualPosition
                                                             / ParameterSet / SpeedOverride, InControl
                                                             / FlangeLoad / Mass
                                                             / PowerTrains / <train> / <motor>
                                   / SafetyStates / <state> / ParameterSet / EmergencyStop, ProtectiveStop ...
                                   / Controllers / <controller> / TaskControls / <task> / TaskControlOperation

Names in angle brackets are chosen by the maker and therefore browsed. The functions here are generators that yield
requests of the types of asyncua and receive the responses.
"""

from __future__ import annotations

import math
import re
from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from asyncua import ua

from daq.opc_ua.channel import CHUNK, CHUNKS, LIMIT, NO_STAMP
from daq.protocol.numerals import plausible
from rigs.schema.condition import MOTORS, PAYLOAD, PROGRAM, SAFETY, SPEED, TEMPERATURES, ProgramState, SafetyState
from rigs.schema.feedback import OPCUARobotics, are_nodes

MODE, EMERGENCY, PROTECTIVE = "OperationalMode", "EmergencyStop", "ProtectiveStop"
DRIVES, OVERRIDE, MASS = "InControl", "SpeedOverride", "Mass"
STATE, READY = "CurrentState", "ReadySubstateMachine.CurrentState"
FRONT = (MODE, EMERGENCY, PROTECTIVE, DRIVES, OVERRIDE)
"""Browse names in the parameter sets of robot and safety state."""
_MANUAL_REDUCED = 1
_STATES = {"Executing": ProgramState.RUNNING, "Ready": ProgramState.STOPPED, "Idle": ProgramState.STOPPED}
"""States of the TaskControlStateMachineType. Names translated by a server are not recognised."""
_SUSPENDED = "Suspended"
"""State of the ReadySubstateMachineType for an interrupted program."""


def condition_of(shown: Mapping[str, Any]) -> dict[str, float]:
    """Columns of the condition; nan if not available. shown: values by browse name (temperatures by column)."""
    state, drives = shown.get(STATE), shown.get(DRIVES)
    program = float(_STATES.get(state, math.nan)) if isinstance(state, str) else math.nan
    if state == "Ready" and shown.get(READY) == _SUSPENDED:
        program = float(ProgramState.PAUSED)
    motors = float(drives) if isinstance(drives, bool) else math.nan
    # Both stop signals must be present before the robot is reported as free of stops.
    emergency, protective, safety = shown.get(EMERGENCY), shown.get(PROTECTIVE), math.nan
    if emergency is True:
        safety = float(SafetyState.EMERGENCY_STOP)
    elif protective is True:
        safety = float(SafetyState.PROTECTIVE_STOP)
    elif emergency is False and protective is False:
        safety = float(SafetyState.REDUCED if shown.get(MODE) == _MANUAL_REDUCED else SafetyState.NORMAL)
    columns = {PROGRAM: program, SAFETY: safety, MOTORS: motors}
    columns |= {SPEED: _number(shown.get(OVERRIDE)), PAYLOAD: _number(shown.get(MASS))}
    return columns | {name: _number(shown.get(name)) for name in TEMPERATURES}


def shown_of(condition: Mapping[str, float]) -> dict[str, Any]:
    """Inverse of `condition_of`."""
    program, safety = condition[PROGRAM], condition[SAFETY]
    return {
        MODE: _MANUAL_REDUCED if safety == SafetyState.REDUCED else 3,
        EMERGENCY: safety == SafetyState.EMERGENCY_STOP,
        PROTECTIVE: safety == SafetyState.PROTECTIVE_STOP,
        DRIVES: condition[MOTORS] == 1,
        OVERRIDE: condition[SPEED],
        MASS: condition[PAYLOAD],
        STATE: "Executing" if program == ProgramState.RUNNING else "Ready",
        READY: _SUSPENDED if program == ProgramState.PAUSED else "AtProgramStart",
    } | {name: condition[name] for name in TEMPERATURES}


def _number(value: Any) -> float:
    return plausible(float(value)) if isinstance(value, int | float) and not isinstance(value, bool) else math.nan


T = TypeVar("T")
Talk = Generator[Any, Any, T]
Children = Mapping[str, Any]

OBJECTS = ua.NodeId(85)
_HIERARCHICAL = ua.NodeId(33)
_ALL_RESULTS = 63
_MOST_PAGES = 100
_MOST_NODES = 10_000
"""Child nodes: more than any robot has, and limited by the size of a message."""
DEGREE, _RADIAN, CELSIUS, KILOGRAM = 17476, 4405297, 4408652, 4933453
"""Units by number in OPC 10000-8: the letters of the UNECE codes (DD, C81, CEL, KGM) as bytes."""
_DEG_PER = {DEGREE: 1.0, _RADIAN: math.degrees(1)}
_DEG_PER_NAME = {"°": 1.0, "deg": 1.0, "degree": 1.0, "degrees": 1.0, "rad": math.degrees(1), "radian": math.degrees(1)}
_NUMBERED = re.compile(r"\D*(\d+)\D*")


class Unfit(Exception):
    """The server does not offer the data required by the rig file. The text includes the remedy."""


@dataclass(frozen=True)
class RobotNodes:
    axes: tuple[Any, ...]
    """Position nodes of q1 … q6."""
    deg_per_unit: tuple[float, ...]
    condition: Mapping[str, Any]

    @property
    def all(self) -> list[Any]:
        return [*self.axes, *self.condition.values()]


class _Browser:
    def __init__(self) -> None:
        self._known: dict[Any, Children] = {}

    def find(self, node: Any, path: str) -> Talk[list[tuple[list[str], list[Any]]]]:
        """Names and nodes on each way below a node that matches the path; `*` is a name chosen by the maker."""
        found = [(list[str](), [node])]
        for wanted in path.split("/"):
            parents = list({nodes[-1]: None for _, nodes in found if nodes[-1] not in self._known})
            self._known |= dict(zip(parents, (yield from children(parents)), strict=True))
            found = [
                ([*names, name], [*nodes, child])
                for names, nodes in found
                for name, child in self._known[nodes[-1]].items()
                if wanted in ("*", name)
            ]
        return found


def robot_nodes(feedback: OPCUARobotics) -> Talk[RobotNodes]:
    if feedback.axes and are_nodes(feedback.axes):
        positions = [ua.NodeId.from_string(axis) for axis in feedback.axes]
        deg_per_unit = yield from _deg_per_unit(feedback.axes, positions, feedback)
        return RobotNodes(tuple(positions), deg_per_unit, {})
    browser = _Browser()
    system, robot = yield from _system_and_robot(browser, feedback)
    found = yield from browser.find(robot, "Axes/*")
    axes = _in_order({names[-1]: nodes[-1] for names, nodes in found}, feedback)
    found = yield from browser.find(robot, "Axes/*/ParameterSet/ActualPosition")
    measured = {names[1]: nodes[-1] for names, nodes in found}
    if missing := [name for name in axes if name not in measured]:
        raise Unfit(f"axis {missing[0]!r} has no ActualPosition; give `axes` as node ids")
    positions = [measured[name] for name in axes]
    deg_per_unit = yield from _deg_per_unit(tuple(axes), positions, feedback)
    shown: Mapping[str, Any] = {}
    if feedback.condition:
        shown = yield from _condition_nodes(browser, system, robot, list(axes.values()))
    return RobotNodes(tuple(positions), deg_per_unit, shown)


def _system_and_robot(browser: _Browser, feedback: OPCUARobotics) -> Talk[tuple[Any, Any]]:
    robots = yield from browser.find(OBJECTS, "DeviceSet/*/MotionDevices/*")
    chosen = [nodes for names, nodes in robots if feedback.device in (None, names[-1])]
    if not robots:
        raise Unfit(
            "the DeviceSet of the server contains no MotionDeviceSystem; give `axes` as node ids, or a different port"
        )
    if len(chosen) != 1:
        shown = ", ".join(names[-1] for names, _ in robots)[:300]
        raise Unfit(f"the server shows the robots {shown}; name one of them as `device`")
    _, _, system, _, robot = chosen[0]
    return system, robot


def _in_order(axes: Children, feedback: OPCUARobotics) -> Children:
    names = ", ".join(axes)[:300] or "none"
    if feedback.axes:
        if missing := [axis for axis in feedback.axes if axis not in axes]:
            raise Unfit(f"axis {missing[0]!r} does not exist; the axes are {names}; correct `axes`")
        return {axis: axes[axis] for axis in feedback.axes}
    numbers = {int(match[1]): name for name in axes if (match := _NUMBERED.fullmatch(name))}
    if len(axes) != 6 or len(numbers) != 6:
        raise Unfit(f"the order of q1 to q6 is unknown; the axes are {names}; list six of them in `axes`")
    return {numbers[number]: axes[numbers[number]] for number in sorted(numbers)}


def _deg_per_unit(names: Sequence[str], positions: Sequence[Any], feedback: OPCUARobotics) -> Talk[tuple[float, ...]]:
    units = yield from engineering_units(positions)
    stated = [
        None if unit is None else _DEG_PER.get(unit.UnitId) or _DEG_PER_NAME.get(_name(unit).lower()) for unit in units
    ]
    if unknown := [k for k, unit in enumerate(units) if unit is not None and stated[k] is None]:
        unit = _name(units[unknown[0]])
        raise Unfit(f"axis {names[unknown[0]]!r} is measured in {unit!r}, which is not an angle unit; correct `axes`")
    declared = {"deg": 1.0, "rad": math.degrees(1)}.get(feedback.units or "")
    scales = tuple(per or declared for per in stated)
    if any(per is None for per in scales):
        raise Unfit(f"the server does not state the unit of axis {names[scales.index(None)]!r}; set `units`")
    return tuple(per for per in scales if per is not None)


def _name(unit: Any) -> str:
    return (unit.DisplayName.Text or "").strip()[:40]


_OF_ROBOT = {**{name: f"ParameterSet/{name}" for name in FRONT}, MASS: "FlangeLoad/Mass"}
_MACHINE = "Controllers/*/TaskControls/*/TaskControlOperation/TaskControlStateMachine"
_OF_SYSTEM = {
    **{name: f"SafetyStates/*/ParameterSet/{name}" for name in FRONT},
    STATE: f"{_MACHINE}/CurrentState",
    READY: f"{_MACHINE}/ReadySubstateMachine/CurrentState",
}
"""Paths of the condition below the robot and below the system. Values of the system have precedence."""


def _condition_nodes(browser: _Browser, system: Any, robot: Any, axes: Sequence[Any]) -> Talk[Mapping[str, Any]]:
    """Available condition nodes; none if there are several safety states or tasks."""
    nodes: dict[str, Any] = {}
    for root, paths in ((robot, _OF_ROBOT), (system, _OF_SYSTEM)):
        for name, path in paths.items():
            found = yield from browser.find(root, path)
            if len(found) == 1:
                nodes[name] = found[0][1][-1]
    nodes |= yield from _motors(browser, robot, axes)
    measured = {name: nodes[name] for name in (MASS, *TEMPERATURES) if name in nodes}
    units = yield from engineering_units(list(measured.values()))
    for name, unit in zip(measured, units, strict=True):
        if unit is None or unit.UnitId != (KILOGRAM if name == MASS else CELSIUS):
            del nodes[name]
    return nodes


def _motors(browser: _Browser, robot: Any, axes: Sequence[Any]) -> Talk[dict[str, Any]]:
    moved: dict[str, list[int]] = {}
    for names, nodes in (yield from browser.find(robot, "PowerTrains/*/*")):
        moved.setdefault(names[1], []).extend(place for place, axis in enumerate(axes) if axis == nodes[-1])
    temperatures: dict[str, Any] = {}
    for names, nodes in (yield from browser.find(robot, "PowerTrains/*/*/ParameterSet/MotorTemperature")):
        if len(driven := moved[names[1]]) == 1:
            temperatures.setdefault(TEMPERATURES[driven[0]], nodes[-1])
    return temperatures


def engineering_units(variables: Sequence[Any]) -> Talk[list[Any | None]]:
    below = yield from children(variables)
    units = yield from values([node["EngineeringUnits"] for node in below if "EngineeringUnits" in node])
    remaining = iter(units)
    read = [next(remaining) if "EngineeringUnits" in node else None for node in below]
    return [unit if isinstance(unit, ua.EUInformation) else None for unit in read]


def values(variables: Sequence[Any]) -> Talk[list[Any]]:
    if not variables:
        return []
    results = (yield read_request(variables)).Results or ()
    read = [None if result.Value is None else result.Value.Value for result in results]
    return [*read, *[None] * len(variables)][: len(variables)]


def read_request(variables: Sequence[Any]) -> Any:
    request = ua.ReadRequest()
    request.Parameters.TimestampsToReturn = ua.TimestampsToReturn.Source
    request.Parameters.NodesToRead = [ua.ReadValueId(node, ua.AttributeIds.Value) for node in variables]
    return request


def children(nodes: Sequence[Any]) -> Talk[list[Children]]:
    """Children of each node by browse name; empty if a node cannot be browsed."""
    if not nodes:
        return []
    request = ua.BrowseRequest()
    request.Parameters.View.Timestamp = NO_STAMP  # of no view
    request.Parameters.NodesToBrowse = [
        ua.BrowseDescription(node, ua.BrowseDirection.Forward, _HIERARCHICAL, True, 0, _ALL_RESULTS) for node in nodes
    ]
    results = (yield request).Results or ()
    if len(results) != len(nodes):
        raise Unfit(f"the server answered for {len(results)} of {len(nodes)} nodes; update the server")
    named = [_node_ids_by_name(result.References) for result in results]
    open_ = {k: result.ContinuationPoint for k, result in enumerate(results) if result.ContinuationPoint}
    for _ in range(_MOST_PAGES):
        if (shown := sum(map(len, named))) > _MOST_NODES:
            raise Unfit(f"the server has {shown} candidate nodes for a robot; give `axes` as node ids")
        if not open_:
            break
        next_page = ua.BrowseNextRequest()
        next_page.Parameters.ReleaseContinuationPoints = False
        next_page.Parameters.ContinuationPoints = list(open_.values())
        pages = dict(zip(open_, (yield next_page).Parameters.Results or (), strict=False))
        for k, page in pages.items():
            named[k] |= _node_ids_by_name(page.References)
        open_ = {k: page.ContinuationPoint for k, page in pages.items() if page.ContinuationPoint}
    return list(named)


def _node_ids_by_name(references: Sequence[Any] | None) -> dict[str, Any]:
    return {reference.BrowseName.Name or "": reference.NodeId for reference in references or ()}


CHANNEL_MS = 3_600_000
_SHORTEST_SESSION_S = 10.0
"""Short, because servers have few sessions, and an abandoned one should expire soon."""
_NONCE = bytes(32)
"""Some servers require 32 bytes even if encryption is off."""
_QUEUED_S = 1.0
_LIFETIME = 10
"""Publishing intervals with no message after which the server deletes the subscription."""


class RequestRefused(Exception):
    """The text is the name of the status code."""


def hello(feedback: OPCUARobotics) -> Any:
    sizes = {"ReceiveBufferSize": CHUNK, "SendBufferSize": CHUNK, "MaxMessageSize": LIMIT}
    return ua.Hello(**sizes, MaxChunkCount=CHUNKS, EndpointUrl=endpoint(feedback))


def endpoint(feedback: OPCUARobotics) -> str:
    return f"opc.{feedback.port}{feedback.path}"


def channel_request(*, renew: bool) -> Any:
    request = ua.OpenSecureChannelRequest()
    kind = ua.SecurityTokenRequestType
    request.Parameters.RequestType = kind.Renew if renew else kind.Issue
    request.Parameters.SecurityMode = ua.MessageSecurityMode.None_
    request.Parameters.RequestedLifetime = CHANNEL_MS
    return request


def session(feedback: OPCUARobotics) -> Talk[None]:
    """Open an anonymous session. Raises Unfit if the server requires a user."""
    request = ua.CreateSessionRequest()
    asked = request.Parameters
    asked.ClientDescription.ApplicationUri = "urn:rig"
    asked.ClientDescription.ApplicationName = ua.LocalizedText("rig")
    asked.ClientDescription.ApplicationType = ua.ApplicationType.Client
    asked.EndpointUrl, asked.SessionName, asked.ClientNonce = endpoint(feedback), "rig", _NONCE
    asked.RequestedSessionTimeout = 1e3 * max(_SHORTEST_SESSION_S, 2 * feedback.timeout_s)
    asked.MaxResponseMessageSize = LIMIT
    created = (yield request).Parameters
    unsecured = [end for end in created.ServerEndpoints or () if end.SecurityMode == ua.MessageSecurityMode.None_]
    tokens = [token for end in unsecured for token in end.UserIdentityTokens or ()]
    anonymous = [token for token in tokens if token.TokenType == ua.UserTokenType.Anonymous]
    if not anonymous:
        raise Unfit("the server requires a user or encryption for reading; allow anonymous reading in the settings")
    activation = ua.ActivateSessionRequest()
    activation.Parameters.UserIdentityToken = ua.AnonymousIdentityToken(PolicyId=anonymous[0].PolicyId)
    yield activation


def subscribed(nodes: RobotNodes, feedback: OPCUARobotics) -> Talk[None]:
    """Subscribe to all nodes, with the indices as handles. Raises RequestRefused without subscriptions.

    The server queues the values of up to a second, each with a timestamp, so the transmission time does not matter. A
    value is sent whenever the timestamp has changed, even if the axis did not move.
    """
    interval_ms = 1e3 / feedback.rate_hz
    request = ua.CreateSubscriptionRequest()
    asked = request.Parameters
    asked.RequestedPublishingInterval, asked.PublishingEnabled = interval_ms, True
    asked.RequestedMaxKeepAliveCount = _keep_alive(interval_ms, feedback)
    asked.RequestedLifetimeCount = _LIFETIME * asked.RequestedMaxKeepAliveCount
    made = (yield request).Parameters
    if made.RevisedPublishingInterval * made.RevisedMaxKeepAliveCount > 500 * feedback.timeout_s:
        change = ua.ModifySubscriptionRequest()
        changed = change.Parameters
        changed.SubscriptionId = made.SubscriptionId
        changed.RequestedPublishingInterval = made.RevisedPublishingInterval
        changed.RequestedMaxKeepAliveCount = _keep_alive(made.RevisedPublishingInterval, feedback)
        changed.RequestedLifetimeCount = _LIFETIME * changed.RequestedMaxKeepAliveCount
        yield change
    items = ua.CreateMonitoredItemsRequest()
    items.Parameters.SubscriptionId = made.SubscriptionId
    # the timestamp of the server if there is no source timestamp
    items.Parameters.TimestampsToReturn = ua.TimestampsToReturn.Both
    items.Parameters.ItemsToCreate = []
    for place, node in enumerate(nodes.all):
        item = ua.MonitoredItemCreateRequest()
        item.ItemToMonitor = ua.ReadValueId(node, ua.AttributeIds.Value)
        item.MonitoringMode = ua.MonitoringMode.Reporting
        sampled = item.RequestedParameters
        sampled.ClientHandle, sampled.SamplingInterval = place, interval_ms
        sampled.QueueSize, sampled.DiscardOldest = max(2, round(1e3 * _QUEUED_S / interval_ms)), True
        sampled.Filter = ua.DataChangeFilter(Trigger=ua.DataChangeTrigger.StatusValueTimestamp)
        items.Parameters.ItemsToCreate.append(item)
    results = (yield items).Results or ()
    refused = [result.StatusCode.name for result in results[: len(nodes.axes)] if not result.StatusCode.is_good()]
    if refused or len(results) < len(nodes.axes):
        raise RequestRefused(refused[0] if refused else "too few answers")


def _keep_alive(interval_ms: float, feedback: OPCUARobotics) -> int:
    return max(1, int(1e3 * feedback.timeout_s / 3 / max(interval_ms, 1.0)))


def publish_request(acknowledged: Any | None = None) -> Any:
    request = ua.PublishRequest()
    if acknowledged is not None:
        number = acknowledged.NotificationMessage.SequenceNumber
        request.Parameters.SubscriptionAcknowledgements = [
            ua.SubscriptionAcknowledgement(acknowledged.SubscriptionId, number)
        ]
    return request
