"""systemd's notify protocol: datagrams to $NOTIFY_SOCKET (sd_notify(3)). Does nothing where there is none."""

from __future__ import annotations

import contextlib
import os
import socket

from rigs.text import plain_lines


def notify(message: str) -> None:
    """Send a message to the service manager, e.g. `READY=1` or `WATCHDOG=1`, a line for each variable."""
    address = os.environ.get("NOTIFY_SOCKET")
    if not address:
        return
    if address.startswith("@"):
        address = "\0" + address[1:]
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sock:
        sock.sendto(plain_lines(message).encode(), address)


def watchdog_s() -> float | None:
    """Return the service manager's time limit between two watchdog messages; None if it has no watchdog."""
    microseconds = os.environ.get("WATCHDOG_USEC", "")
    meant_for = os.environ.get("WATCHDOG_PID", str(os.getpid()))
    if not microseconds.isdigit() or meant_for != str(os.getpid()):
        return None
    return int(microseconds) / 1e6
