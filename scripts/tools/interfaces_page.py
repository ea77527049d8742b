"""The page docs/interfaces.md from the schemas and the peers: `scripts/dev interfaces_page > docs/interfaces.md`.

What an interface is known from is read off its class (`rigs.interfaces`), what it was held against off `PEERS` of
tests/trials/wire_peers/__main__.py. The list of what is left out stands here.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

HEAD = """\
# Interfaces, and how sure we are of each

`rig interfaces` lists them on the screen, with line settings and times. *Standing*: confirmed means read in the
maker's manual or in public code, or seen on a wire; weak means second-hand; unconfirmed means believed. *Held against*
names the independent implementations that an end of ours was run against; they share no code with ours unless it says
so. `scripts/dev wire_peers` runs them again. Where none is named, our host was held against replies as the source has
them, and against our own emulator.

This page is generated: `scripts/dev interfaces_page > docs/interfaces.md`.
"""
LEFT_OUT = (
    (
        "KUKA Ethernet KRL (EKI)",
        "`line_feed` with `listens: true`",
        "the XML of each program is its own, so that there is no message to know; a line of text does the same",
    ),
    (
        "ROS 2 without rosbridge (DDS)",
        "`ros2_joint_states`",
        "a DDS library brings settings of its own (domain, quality of service) and compiled parts; "
        "rosbridge needs neither",
    ),
    (
        "Doosan, Franka",
        "`ros2_joint_states`",
        "their ROS 2 drivers publish the same joints",
    ),
    (
        "IO-Link masters (JSON over HTTP)",
        "–",
        "not built yet; each device has its own layout of process data",
    ),
    (
        "Yaskawa High-Speed Ethernet Server",
        "`modbus_joints`, `line_feed`",
        "not built yet; joints come in pulses (believed), whose number per degree would be needed for each arm",
    ),
    (
        "Beckhoff ADS",
        "`modbus_map` by the controller's Modbus TCP server",
        "not built yet; it needs a route set in the controller and the names of its program",
    ),
    (
        "Keyence DL-EN1",
        "`keyence_dl_rs1a` on RS-232C",
        "not built yet; its EtherNet/IP assemblies were not looked into",
    ),
    (
        "Mitutoyo U-WAVE, USB-ITN",
        "`mitutoyo_usb`",
        "U-WAVE is not built yet; USB-ITN types as a keyboard does, which gives no time",
    ),
    (
        "Heidenhain EIB 741, Sylvac Bluetooth",
        "Heidenhain displays, Sylvac cables",
        "not built yet; their sources were not looked into",
    ),
)
"""Interface, what to use instead, why it is left out."""


def page() -> str:
    """The whole page as Markdown."""
    left_out = ["## Left out, and why", "", *_table(("interface", "instead", "why"), LEFT_OUT)]
    return "\n".join([HEAD, *_section("Gauges", "gauge"), *_section("Robots", "robot"), *left_out, ""])


def _section(title: str, kind: str) -> list[str]:
    from rigs.interfaces import known  # noqa: PLC0415
    from tests.trials.wire_peers.__main__ import PEERS  # noqa: PLC0415 - the script first puts the repository on the path

    rows = []
    for one in known():
        if one.kind == kind:
            peers = "; ".join(f"{peer.name} ({peer.what})" for peer in PEERS if one.name in peer.interfaces)
            origin = one.origin
            says = (origin.standing, origin.source, origin.doubts or "–", peers or "–")
            rows.append((f"`{one.name}`", origin.instruments, *says))
    head = ("interface", "instruments", "standing", "source", "in doubt", "held against")
    return [f"## {title}", "", *_table(head, rows), ""]


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    cells = [[cell.replace("|", "\\|") for cell in row] for row in (head, ["---"] * len(head), *rows)]
    return [f"| {' | '.join(row)} |" for row in cells]


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[2]))
    sys.stdout.write(page())
