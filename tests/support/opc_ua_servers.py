"""A robot in an OPC UA server of the asyncua library, with independent sessions, subscriptions and address space."""

from __future__ import annotations

import asyncio
import logging
import socket
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from typing import Any

from asyncua import ua
from asyncua.sync import Server, ThreadLoop

DEGREE, RADIAN, MILLIMETRE = (17476, "°"), (4405297, "rad"), (5066068, "mm")


class LibraryRobot:
    """Nodes of the robot. positions: of q1 … q6; condition: by browse name."""

    def __init__(self, server: Any, port: int) -> None:
        self.server = server
        self.port = f"tcp://127.0.0.1:{port}"
        self.positions: list[Any] = []
        self.condition: dict[str, Any] = {}

    def built(self, unit: tuple[int, str] | None, names: Sequence[str]) -> LibraryRobot:
        """Build the address space. All names except those of OPC UA itself are in one namespace."""
        self._space = self.server.register_namespace("http://opcfoundation.org/UA/Robotics/")
        system = self._object(self._object(self.server.nodes.objects, "DeviceSet"), "System")
        robot = self._object(self._object(system, "MotionDevices"), "Robot")
        axes, trains = self._object(robot, "Axes"), self._object(robot, "PowerTrains")
        for number, name in enumerate(names, 1):
            axis = self._object(axes, name)
            position = self._variable(self._object(axis, "ParameterSet"), "ActualPosition", 0.0)
            self._state(position, unit)
            self.positions.append(position)
            train = self._object(trains, f"Train{number}")
            train.add_reference(axis, ua.ObjectIds.Organizes)
            motor = self._object(self._object(train, "Motor"), "ParameterSet")
            self._state(self._variable(motor, "MotorTemperature", 30.0 + number), (4408652, "°C"))
        own = self._object(robot, "ParameterSet")
        safety = self._object(self._object(self._object(system, "SafetyStates"), "State"), "ParameterSet")
        tasks = self._object(self._object(self._object(system, "Controllers"), "Controller"), "TaskControls")
        operation = self._object(self._object(tasks, "Task"), "TaskControlOperation")
        machine = self._object(operation, "TaskControlStateMachine")
        shown = [(own, "InControl", True), (own, "SpeedOverride", 100.0), (safety, "OperationalMode", 3)]
        shown += [(safety, "EmergencyStop", False), (safety, "ProtectiveStop", False)]
        shown += [(machine, "CurrentState", ua.LocalizedText("Executing"))]
        self.condition = {name: self._variable(parent, name, value) for parent, name, value in shown}
        return self

    def drive(self, angles: Sequence[float], at: datetime | None, status: int = 0) -> None:
        """Write all positions with the same timestamp."""
        for node, angle in zip(self.positions, angles, strict=True):
            node.write_value(ua.DataValue(ua.Variant(float(angle)), ua.StatusCode(status), SourceTimestamp=at))

    def _object(self, parent: Any, name: str) -> Any:
        return parent.add_object(self._space, name)

    def _variable(self, parent: Any, name: str, value: object) -> Any:
        return parent.add_variable(self._space, name, value)

    def _state(self, variable: Any, unit: tuple[int, str] | None) -> None:
        if unit is not None:
            stated = ua.EUInformation(UnitId=unit[0], DisplayName=ua.LocalizedText(unit[1]))
            variable.add_property(0, "EngineeringUnits", stated)


@contextmanager
def library_robot(
    unit: tuple[int, str] | None = DEGREE, names: Sequence[str] = tuple(f"Axis_{axis}" for axis in range(1, 7))
) -> Iterator[LibraryRobot]:
    """Run a server on the loopback interface, with a robot, or without one if `names` is empty."""
    logging.getLogger("asyncua").setLevel(logging.CRITICAL)
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with ThreadLoop() as loop:
        server = Server(tloop=loop)
        server.set_endpoint(f"opc.tcp://127.0.0.1:{port}")
        server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
        server.start()
        try:
            robot = LibraryRobot(server, port)
            yield robot.built(unit, names) if names else robot
        finally:
            server.stop()
            loop.post(_end_what_is_left())


async def _end_what_is_left() -> None:
    """Cancel the tasks of sessions and subscriptions that the server leaves running after a stop."""
    left = asyncio.all_tasks() - {asyncio.current_task()}
    for task in left:
        task.cancel()
    await asyncio.gather(*left, return_exceptions=True)


def now() -> datetime:
    """Time of this computer, used as the controller's timestamp."""
    return datetime.now(UTC)
