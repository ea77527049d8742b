import pytest
from pydantic import ValidationError

from daq.discovery.attempts import attempts, missing_keys, named_attempts
from daq.discovery.port_search import host_of
from rigs.interfaces import list_interfaces
from tests.support.simulated_conversation import Script

PORT = "/dev/ttyUSB0"


def test_every_confirmed_gauge_is_tried_and_no_other():
    confirmed = {one.name for one in list_interfaces() if one.kind == "gauge" and one.origin.standing == "confirmed"}
    assert {attempt.interface for attempt in attempts(PORT)} == confirmed


def test_these_requests_are_sent_and_no_other():
    """As docs/rig-init.md lists them: what is added here is sent to machines that nobody has named."""
    sent = {attempt.request for attempt in attempts(PORT) if attempt.sends == "requests"}
    texts = {b"?\r", b"M0\r\n", b"R\r", b"M\r", b"1\r", b"\x02", b"\x1bA0800\r"}
    assert sent == texts | {bytes.fromhex("01 04 00c8 000d b031")}


def test_the_makers_line_settings_come_before_others():
    lines = {one.name: one.line for one in list_interfaces()}
    asked = [attempt for attempt in attempts(PORT) if attempt.sends == "requests"]
    declared = [attempt for attempt in asked if str(attempt.line) == lines[attempt.interface]]
    assert len(declared) > 5
    # Baumer's own settings are those of the shipped rig, not the default of any Modbus gauge.
    first_others = [str(attempt.line) != lines[attempt.interface] for attempt in asked].index(True)
    assert {a.interface for a in asked[first_others:][:1]} == {"modbus_map"} and first_others >= len(declared) - 1


def test_over_the_network_a_gauge_speaks_modbus():
    assert [attempt.interface for attempt in attempts("tcp://127.0.0.1:502")] == ["modbus_map"]


@pytest.mark.parametrize("attempt", attempts(PORT)[:30], ids=lambda a: f"{a.interface} {a.line} {a.sends}")
def test_only_requests_are_sent(attempt):
    """Driven for seconds of silence and of noise: nothing that sets an instrument leaves."""
    script = Script(host_of(attempt.gauges, attempt.sends, 0.3))
    assert script.sent == b""  # what a conversation opens with is ignored
    for _ in range(20):
        script.wake() if script.step.wake_ns is not None else None
        script.receive(b"\x00garbage\r\n+1.2", script.now_ns + 50_000_000)
    for setting in (b"OUT0", b"OUT1", b"OUTPUT"):
        assert setting not in script.sent
    if attempt.sends == "nothing":
        assert script.sent == b""


def test_a_named_instrument_is_spoken_to_as_rigd_would():
    tried = named_attempts({"interface": "micro_epsilon_ild1420", "port": PORT, "range_mm": 25})
    assert str(tried[0].line) == "921600 8N1" and tried[0].sends == "all" and len(tried) > 5
    assert Script(host_of(tried[0].gauges, "all", 0.3)).sent == b"OUTPUT RS422\n"
    (only,) = named_attempts({"interface": "tesa_tt", "port": PORT, "line": "9600 8N1"})
    assert str(only.line) == "9600 8N1"


def test_a_named_instrument_needs_its_keys():
    with pytest.raises(ValidationError, match="range_mm"):
        named_attempts({"interface": "micro_epsilon_ild1420", "port": PORT})
    with pytest.raises(ValidationError):
        named_attempts({"interface": "no such", "port": PORT})
    assert missing_keys("micro_epsilon_ild1420") == ["range_mm"]


def test_an_attempt_that_hears_nothing_ends():
    (first, *_) = [attempt for attempt in attempts(PORT) if attempt.interface == "tesa_tt"]
    script = Script(host_of(first.gauges, first.sends, 0.3))
    for _ in range(5):
        if script.step.hang_up:
            break
        script.wake()
    assert script.step.hang_up and script.sent == b"?\r"
