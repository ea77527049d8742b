"""Generate docs/interfaces.md from the interface schemas: `scripts/dev interfaces_page > docs/interfaces.md`.

Independent implementations come from `PEERS` of tests/trials/wire_peers.py. The list of unsupported interfaces is in
this file.
"""

from __future__ import annotations

import sys
from pathlib import Path

HEAD = """\
# Interfaces to gauges and robots

This page lists the interfaces that a [rig file](rig-file.md) can name, with their default line settings.
`rig interfaces` also prints the source of each protocol, what is in doubt, and the time of a reading. The standing of a
protocol is

- *confirmed*: read in the manual of the maker or in public code, or recorded from an instrument;
- *weak*: second-hand;
- *unconfirmed*: assumed.

All interfaces are tested with replies from their source and with the emulators of rig.

This page is generated: `scripts/dev interfaces_page > docs/interfaces.md`.
"""
LEFT_OUT = (
    (
        "KUKA Ethernet KRL (EKI)",
        "`line_feed` with `listens: true`",
        "each program defines its own XML, so there is no common message",
    ),
    (
        "ROS 2 without rosbridge (DDS)",
        "`ros2_joint_states`",
        "a DDS library needs settings (domain, quality of service) and compiled parts; rosbridge needs neither",
    ),
    ("Doosan, Franka", "`ros2_joint_states`", "the ROS 2 drivers publish the same joints"),
    ("IO-Link masters (JSON over HTTP)", "–", "not implemented; process data differ between devices"),
    (
        "Yaskawa High-Speed Ethernet Server",
        "`modbus_joints`, `line_feed`",
        "not implemented; joints are in pulses (assumed), with a different number per degree for each arm",
    ),
    (
        "Beckhoff ADS",
        "`modbus_map` with the Modbus TCP server of the controller",
        "not implemented; it needs a route in the controller and the names in the program",
    ),
    (
        "Keyence DL-EN1",
        "`keyence_dl_rs1a` on RS-232C",
        "not implemented; the EtherNet/IP assemblies were not examined",
    ),
    (
        "Mitutoyo U-WAVE, USB-ITN",
        "`mitutoyo_usb`",
        "U-WAVE is not implemented; USB-ITN acts as a keyboard and gives no time",
    ),
    (
        "Heidenhain EIB 741, Sylvac Bluetooth",
        "Heidenhain displays, Sylvac cables",
        "not implemented; the sources were not examined",
    ),
)
"""Interface, alternative, and reason why it is not supported."""


def page() -> str:
    """Return the complete page as Markdown."""
    left_out = ["## Not supported", "", *(_left_out(*one) for one in LEFT_OUT)]
    return "\n".join([HEAD, *_table("Gauges", "gauge"), *_table("Robots", "robot"), *_peers(), *left_out, ""])


def _left_out(name: str, instead: str, why: str) -> str:
    """Return the list item of an unsupported interface."""
    alternative = "" if instead == "–" else f" Use {instead}."
    return f"- **{name}**: {why}.{alternative}"


def _table(title: str, kind: str) -> list[str]:
    """The interfaces of a kind; only those of gauges have default line settings."""
    from rigs.interfaces import NO_DEFAULT, list_interfaces  # noqa: PLC0415 - the script first sets the path

    is_gauge = kind == "gauge"
    line, rule = (" line |", " --- |") if is_gauge else ("", "")
    lines = [f"## {title}", "", f"| interface | instruments |{line}", f"| --- | --- |{rule}"]
    for one in list_interfaces():
        if one.kind != kind:
            continue
        standing = "" if one.origin.standing == "confirmed" else f" ({one.origin.standing})"
        line = f" {'required' if one.line == NO_DEFAULT else one.line} |" if is_gauge else ""
        lines.append(f"| `{one.name}` | {one.origin.instruments}{standing} |{line}")
    return [*lines, ""]


def _peers() -> list[str]:
    from tests.trials.wire_peers import PEERS  # noqa: PLC0415

    lines = ["## Tested against other implementations", ""]
    lines += ["Unless stated, they share no code with rig. `scripts/dev wire_peers` repeats the tests.", ""]
    for interface in dict.fromkeys(peer.interfaces for peer in PEERS):
        peers = "; ".join(f"{peer.name} ({peer.what})" for peer in PEERS if peer.interfaces == interface)
        lines.append(f"- `{'`, `'.join(interface)}`: {peers}")
    return [*lines, ""]


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[2]))
    from tests.support.markdown import wrapped

    sys.stdout.write(wrapped(page()))
