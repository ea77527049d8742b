import asyncio
import math
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from pymodbus.client import ModbusTcpClient
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

import daq.gauges
from daq.acquisition.stream_buffer import samples_of
from daq.protocol.conversation import Conversation, FaultKind, Item
from tests.support.drivers import PLAIN, modbus


@contextmanager
def _pymodbus_server(*units: list[int]) -> Iterator[int]:
    """pymodbus' TCP server with units 1, 2 … holding these registers from 200 on; gives its port."""
    started: dict[str, object] = {}
    ready = threading.Event()

    async def serve() -> None:
        devices = [
            SimDevice(number, simdata=[SimData(200, values=registers, datatype=DataType.REGISTERS)])
            for number, registers in enumerate(units, start=1)
        ]
        server = ModbusTcpServer(devices, address=("127.0.0.1", 0))
        await server.serve_forever(background=True)
        over = asyncio.Event()
        started["port"] = server.transport.sockets[0].getsockname()[1]
        started["stop"] = over.set
        started["loop"] = asyncio.get_running_loop()
        ready.set()
        await over.wait()
        await server.shutdown()

    thread = threading.Thread(target=lambda: asyncio.run(serve()))
    thread.start()
    assert ready.wait(60)
    try:
        yield started["port"]
    finally:
        started["loop"].call_soon_threadsafe(started["stop"])
        thread.join(60)


def _talk(conversation: Conversation, link: socket.socket, enough: int) -> list[Item]:
    """Run a conversation on a socket until it has told enough, or for a device until the peer leaves."""
    items: list[Item] = []
    step = conversation.connected(time.monotonic_ns())
    while True:
        items += step.items
        if len(items) >= enough:
            return items
        if step.send:
            link.sendall(step.send)
        now_ns = time.monotonic_ns()
        link.settimeout(None if step.wake_ns is None else max(1e-4, (step.wake_ns - now_ns) * 1e-9))
        try:
            data = link.recv(4096)
        except TimeoutError:
            step = conversation.tick(time.monotonic_ns())
            continue
        if not data:
            return items
        step = conversation.received(data, time.monotonic_ns())


def test_our_host_reads_pymodbus_server():
    registers = [1, 0, 0x7C37, 0x428B, *[0] * 5, 5, 0, 7, 0]
    with _pymodbus_server(registers) as port:
        gauge = modbus(port=f"tcp://127.0.0.1:{port}", timeout_s=0.05)
        with socket.create_connection(("127.0.0.1", port), timeout=60) as link:
            items = _talk(daq.gauges.host([gauge]), link, 50)
    samples = samples_of(items)
    assert len(samples) >= 50 and len(samples) == len(items)
    assert {round(sample.values[0], 3) for sample in samples} == {69.743}
    assert {sample.status for sample in samples} == {1}
    assert {sample.device_time_s for sample in samples} == {5.000007}


def test_our_host_reads_three_units_behind_one_address_of_pymodbus():
    kinds = {"float64": -1.25, "int32": -70000, "uint16": 54321}
    types = ModbusTcpClient.DATATYPE
    packed = [
        [*ModbusTcpClient.convert_to_registers(value, types[kind.upper()], word_order="little"), 0, 0, 0, 0][:4]
        for kind, value in kinds.items()
    ]
    with _pymodbus_server(*packed) as port:
        common = {"port": f"tcp://127.0.0.1:{port}", "count": 4, "timeout_s": 0.2, **PLAIN}
        gauges = [
            modbus(unit=number, value={"address": 200, "type": kind}, **common)
            for number, kind in enumerate(kinds, start=1)
        ]
        with socket.create_connection(("127.0.0.1", port), timeout=60) as link:
            items = _talk(daq.gauges.host(gauges), link, 60)
    samples = samples_of(items)
    assert len(samples) == len(items) and {sum(map(math.isfinite, sample.values)) for sample in samples} == {1}
    read = [{s.values[place] for s in samples if math.isfinite(s.values[place])} for place in range(3)]
    assert read == [{value} for value in kinds.values()]


def test_our_host_understands_pymodbus_refusal():
    with _pymodbus_server([0] * 5) as port:
        gauge = modbus(port=f"tcp://127.0.0.1:{port}", timeout_s=0.05)
        with socket.create_connection(("127.0.0.1", port), timeout=60) as link:
            (fault,) = _talk(daq.gauges.host([gauge]), link, 1)
    assert fault.kind is FaultKind.DEVICE_ERROR
    assert "ILLEGAL_ADDRESS" in fault.detail


def test_pymodbus_client_reads_our_device():
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
        device = daq.gauges.device([modbus(port=f"tcp://127.0.0.1:{port}")], lambda now_ns: [69.743])

        def serve() -> None:
            link, _ = listener.accept()
            with link:
                _talk(device, link, 1)

        thread = threading.Thread(target=serve)
        thread.start()
        client = ModbusTcpClient("127.0.0.1", port=port, retries=0, timeout=60)
        try:
            assert client.connect()
            answer = client.read_input_registers(200, count=13, device_id=1)
            value = client.convert_from_registers(answer.registers[2:4], client.DATATYPE.FLOAT32, word_order="little")
            refused = client.read_input_registers(300, count=2, device_id=1)
            unknown = client.read_holding_registers(200, count=2, device_id=1)
            coils = client.read_coils(0, count=1, device_id=1)
        finally:
            client.close()
            thread.join(60)
    assert value == pytest.approx(69.743)
    assert (refused.exception_code, unknown.exception_code, coils.exception_code) == (2, 1, 1)
    assert device.sent == 1
