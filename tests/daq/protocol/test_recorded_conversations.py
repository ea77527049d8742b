import pkgutil
import random
from collections.abc import Sequence

import pytest

import daq.gauge_drivers
import daq.robot_drivers
from daq.protocol.framing import LIMIT
from tests.support.conversation_logs import FOLDER, LOGS, Section, written
from tests.support.drivers import OPC_UA
from tests.support.simulated_conversation import S

ENDLESS = b"x" * (2 * LIMIT + 17)
NAMES = [name for name in LOGS if OPC_UA or name != "opc_ua_robotics"]
STREAMS = [one for name in NAMES for one in LOGS[name] if one.replies and one.is_stream]


def test_every_driver_has_a_record():
    folders = (daq.gauge_drivers, daq.robot_drivers)
    drivers = {module.name for folder in folders for module in pkgutil.iter_modules(folder.__path__)}
    assert set(LOGS) == drivers | {"opc_ua_robotics"} and all(LOGS.values())


@pytest.mark.parametrize("name", NAMES)
def test_drivers_repeat_the_recorded_conversations(name):
    log, readings = written(LOGS[name])
    assert log == (FOLDER / f"{name}.log").read_text(encoding="ascii")
    assert readings == (FOLDER / f"{name}.readings").read_text(encoding="utf-8")


def _outcome(section: Section, pieces: Sequence[bytes]) -> tuple[bytes, list[object], bool]:
    script = section.begun()
    now_ns = script.now_ns + S // 10
    for piece in pieces:
        script.receive(piece, now_ns)
    hung_up = script.step.hang_up
    for _ in range(3):
        if script.step.wake_ns is not None:
            script.wake()
    return script.sent, list(script.items), hung_up


@pytest.mark.parametrize("section", STREAMS, ids=lambda section: f"{section.peers[0].split()[1]}: {section.title}")
def test_cut_replies_make_no_difference(section):
    dice = random.Random(5)
    for reply in [*section.replies, ENDLESS]:
        whole = _outcome(section, [reply])
        assert whole[1]
        cuts = sorted(dice.choices(range(len(reply) + 1), k=5))
        pieces = [reply[a:b] for a, b in zip([0, *cuts], [*cuts, len(reply)], strict=True)]
        assert _outcome(section, list(filter(None, pieces))) == whole
        assert _outcome(section, [reply[k : k + 1] for k in range(len(reply))]) == whole
