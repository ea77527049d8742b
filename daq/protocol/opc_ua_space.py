"""The address space of an emulated controller: one robot by the browse names of OPC 40010-1."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from asyncua import ua

from daq.protocol.opc_ua_condition import DRIVES, EMERGENCY, MASS, MODE, OVERRIDE, PROTECTIVE, READY, STATE
from daq.protocol.opc_ua_nodes import CELSIUS, DEGREE, KILOGRAM, OBJECTS
from rigs.schema.condition import TEMPERATURES
from rigs.schema.feedback import OPCUARobotics, are_nodes

_OURS = 4
"""The number of the namespace in which this server's nodes are."""
_UNIT_NAMES = {DEGREE: "°", CELSIUS: "°C", KILOGRAM: "kg"}


@dataclass
class Space:
    """Nodes. below: of each its children, as (browse name, node); variables: the names of what they show; units: of
    those that state one, by the node of the statement."""

    below: dict[Any, list[tuple[str, Any]]] = field(default_factory=dict)
    variables: dict[Any, str] = field(default_factory=dict)
    units: dict[Any, int] = field(default_factory=dict)

    def add(self, path: str, shows: str | None = None, unit: int | None = None, node: Any | None = None) -> Any:
        """Add a node by its path below Objects, with those above it that are missing; returns it."""
        above, _, name = path.rpartition("/")
        parent = self.add(above) if above else OBJECTS
        node = node or ua.NodeId(path, _OURS)
        if (name, node) not in self.below.setdefault(parent, []):
            self.below[parent].append((name, node))
        if shows is not None:
            self.variables[node] = shows
        if unit is not None:
            self.units[ua.NodeId(f"{path}/EngineeringUnits", _OURS)] = unit
            self.below.setdefault(node, []).append(("EngineeringUnits", ua.NodeId(f"{path}/EngineeringUnits", _OURS)))
        return node

    def browsed(self, node: Any) -> Any:
        """Return what a client finds below a node."""
        references = [
            ua.ReferenceDescription(NodeId=child, BrowseName=ua.QualifiedName(name, _OURS))
            for name, child in self.below.get(node, [])
        ]
        return ua.BrowseResult(References=references)

    def shows(self, node: Any) -> str | None:
        """Return the name of what a variable shows; None for any other node."""
        return self.variables.get(node)

    def is_position(self, node: Any) -> bool:
        """Return whether a node is the position of an axis."""
        return (self.variables.get(node) or "").startswith("q")

    def constant(self, node: Any) -> Any:
        """Return the value of a unit; of any other node, that it has none."""
        if node not in self.units:
            return ua.DataValue(StatusCode=ua.StatusCode(ua.StatusCodes.BadAttributeIdInvalid))
        unit = self.units[node]
        return ua.DataValue(ua.Variant(ua.EUInformation(UnitId=unit, DisplayName=ua.LocalizedText(_UNIT_NAMES[unit]))))


def robot_space(feedback: OPCUARobotics) -> Space:
    """Return a robot with the axes that a rig file names. Where that states the unit of angles, the server does not."""
    space, unit = Space(), None if feedback.units else DEGREE
    system, robot = "DeviceSet/System", f"DeviceSet/System/MotionDevices/{feedback.device or 'Robot'}"
    for number, (name, node) in enumerate(_axes(feedback), 1):
        axis = space.add(f"{robot}/Axes/{name}")
        space.add(f"{robot}/Axes/{name}/ParameterSet/ActualPosition", f"q{number}", unit, node)
        train = f"{robot}/PowerTrains/PowerTrain_{number}"
        space.add(f"{train}/Motor_1/ParameterSet/MotorTemperature", TEMPERATURES[number - 1], CELSIUS)
        space.add(f"{train}/{name}", node=axis)
    for name in (DRIVES, OVERRIDE):
        space.add(f"{robot}/ParameterSet/{name}", name)
    space.add(f"{robot}/FlangeLoad/Mass", MASS, KILOGRAM)
    for name in (MODE, EMERGENCY, PROTECTIVE):
        space.add(f"{system}/SafetyStates/SafetyState/ParameterSet/{name}", name)
    machine = f"{system}/Controllers/Controller/TaskControls/Task/TaskControlOperation/TaskControlStateMachine"
    space.add(f"{machine}/CurrentState", STATE)
    space.add(f"{machine}/{READY.replace('.', '/')}", READY)
    return space


def _axes(feedback: OPCUARobotics) -> Iterator[tuple[str, Any | None]]:
    """Names of q1 … q6, and the nodes of their positions where the rig file gives those."""
    declared: Sequence[str] = feedback.axes or ()
    if declared and are_nodes(declared):
        yield from ((f"Axis_{number}", ua.NodeId.from_string(axis)) for number, axis in enumerate(declared, 1))
        return
    yield from ((name, None) for name in declared or [f"Axis_{number}" for number in range(1, 7)])
