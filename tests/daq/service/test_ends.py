import signal
import threading
import time

from daq.acquisition.reader import StreamReader
from daq.acquisition.stream_buffer import StreamBuffer
from daq.acquisition.streams import Stream, streams_of
from daq.service.client import Client
from daq.service.control import ControlServer
from daq.wire.links import Link
from rigs.errors import CellError
from rigs.load import parse
from tests.support.bench import rig_text


def test_waiting_client_gets_its_answer_when_the_daemon_ends(tmp_path):
    asked, may_answer, commands = threading.Event(), threading.Event(), []

    def answer(request: dict[str, object]) -> dict[str, object]:
        commands.append(request["command"])
        asked.set()
        may_answer.wait(60)
        return {"run": "x", "counters": {}}

    server = ControlServer(tmp_path / "socket", answer)
    server.start()
    answers: list[object] = []

    def client() -> None:
        with Client(tmp_path / "socket") as waiting:
            answers.append(waiting.ask("record_stop"))
            try:
                answers.append(waiting.ask("record_start"))
            except CellError as error:
                answers.append(error.code)

    asking = threading.Thread(target=client)
    asking.start()
    with Client(tmp_path / "socket"):  # connected, and silent: it keeps nothing waiting
        assert asked.wait(60)
        closing = threading.Thread(target=server.close)
        closing.start()
        time.sleep(0.3)
        assert closing.is_alive() and not (tmp_path / "socket").exists()
        may_answer.set()
        closing.join(60)
        asking.join(60)
    assert answers == [{"run": "x", "counters": {}}, "daemon.silent"]
    assert commands == ["record_stop"]


def test_slowly_opening_port_is_no_hanging_reader(monkeypatch):
    opening, resolved = threading.Event(), threading.Event()

    def resolve(*_: object) -> Link:
        opening.set()
        resolved.wait(60)
        raise CellError("robot", "unknown host", "correct it")

    monkeypatch.setattr(Stream, "open", resolve)
    robot = streams_of(parse(rig_text(), "bench"))[-1]
    buffer = StreamBuffer(robot.name, robot.columns)
    reader = StreamReader(robot, buffer, _lost(robot))
    reader.start()
    try:
        assert opening.wait(60)
        time.sleep(0.2)
        assert buffer.alive(0.1)
        resolved.set()
        reader.stop()
        reader.join(60)
        time.sleep(0.2)
        assert not buffer.alive(0.1)  # a reader that goes round no more is told from one that opens its port
    finally:
        resolved.set()
        reader.stop()


def _lost(stream: Stream) -> Link:
    return Link(stream.name, -1, lambda: None)


def test_ctrl_c_ends_an_emulated_cell_with_130(bench):
    with bench.emulating("paper-fanuc", end=signal.SIGINT, code=130):
        pass
