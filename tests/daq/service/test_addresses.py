import subprocess
import sys

import yaml

from daq.service.addresses import drop_in, resolved
from rigs.load import SHIPPED, parse
from tests.support.refusals import refused

RESOLV_CONF = "# made by hand\nnameserver 127.0.0.53\nnameserver fe80::1%eth0\nsearch plant\noptions edns0\n"
NAMES = {"robot.plant": ["192.168.7.7", "fd00::7"], "localhost": ["127.0.0.1"]}


def allowed(gauges: str, feedback: str, interface: str = "ur_rtde", **more: bool) -> list[str]:
    data = yaml.safe_load((SHIPPED / "ur10e-cell.yaml").read_text())
    data["gauges"] = yaml.safe_load((SHIPPED / "paper-fanuc.yaml").read_text())["gauges"]
    for name, port in zip(("g1", "g2"), gauges.split(), strict=True):
        data["gauges"][name]["port"] = port
    data["feedback"] = {"interface": interface, "port": feedback} | more
    text = drop_in(parse(yaml.safe_dump(data), "rig.yaml"), NAMES.__getitem__, RESOLV_CONF)
    head, section, *lines = text.splitlines()
    assert head.startswith("# ") and section == "[Service]"
    assert all(line.startswith("IPAddressAllow=") for line in lines)
    return [line.partition("=")[2] for line in lines]


def test_an_address_is_allowed_and_no_other():
    assert allowed("/dev/ttyUSB0 /dev/ttyUSB1", "tcp://192.168.1.10:30004") == ["192.168.1.10"]
    assert allowed("tcp://192.168.1.20:502 tcp://[fd00::5]:502", "tcp://192.168.1.20:30004") == [
        "192.168.1.20",
        "fd00::5",
    ]


def test_a_name_is_allowed_with_who_knows_it():
    assert allowed("/dev/ttyUSB0 /dev/ttyUSB1", "tcp://robot.plant:30004") == ["192.168.7.7", "fd00::7", "127.0.0.53"]


def test_for_a_controller_that_speaks_first_private_networks_are_allowed():
    found = allowed("/dev/ttyUSB0 /dev/ttyUSB1", "udp://0.0.0.0:49152", "kuka_rsi")
    assert {"10.0.0.0/8", "192.168.0.0/16"} < set(found) and "any" not in found
    assert "10.0.0.0/8" in allowed("/dev/ttyUSB0 /dev/ttyUSB1", "tcp://192.168.1.5:9000", "line_feed", listens=True)
    assert allowed("/dev/ttyUSB0 /dev/ttyUSB1", "udp://192.168.1.5:60015", "fanuc_stream_motion") == ["192.168.1.5"]


def test_unknown_name_is_one_line():
    with refused("address.invalid", "Name or service not known"):
        resolved("no-such-host.invalid")


def test_as_scripts_install_calls_it(tmp_path):
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text("name: [")
    command = [sys.executable, "-m", "daq.service.addresses"]
    done = subprocess.run([*command, "ur10e-cell"], capture_output=True, text=True, check=True)
    assert "IPAddressAllow=" in done.stdout and not done.stderr
    done = subprocess.run([*command, wrong], capture_output=True, text=True, check=False)
    assert done.returncode == 3 and done.stderr.count("\n") == 1 and not done.stdout
