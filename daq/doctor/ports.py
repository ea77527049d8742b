"""A serial port before anything is said on it: there, named to last, allowed, free, and quick.

`root` is where the system's tree begins, so that a test can build one. Nothing is opened.
"""

from __future__ import annotations

import contextlib
import getpass
import grp
import os
import re
from collections.abc import Iterator
from pathlib import Path

from daq.doctor.finding import Finding, Verdict, doubtful, ok, wrong
from daq.wire.serial_port import port_names

_BY_PLUGGING_ORDER = re.compile(r"/dev/tty(USB|ACM)\d+")
_GREEDY = ("ModemManager", "brltty")
"""Programs that open new serial ports by themselves."""
_GROUP = "dialout"
_LONG_MS = 2


def examine_port(about: str, port: str, root: Path, *, served: bool) -> Iterator[Finding]:
    """Yield findings on a serial port, up to the first that is wrong; rigd may hold the port."""
    checks = (present, lasting, quick) if served else (present, lasting, allowed, free, quick)
    for check in checks:
        if finding := check(about, port, root):
            yield finding
            if finding.verdict is Verdict.WRONG:
                return


def present(about: str, port: str, root: Path) -> Finding:
    """Check whether the port exists."""
    if _at(port, root).exists():
        return ok(about, f"{port} exists")
    ports = ", ".join(port_names(root)) or "none"
    return wrong(
        about, f"{port}: no such port", f"plug it in and switch it on, or correct the port; ports here: {ports}"
    )


def lasting(about: str, port: str, root: Path) -> Finding | None:
    """Check whether the port's name stays with the adapter; None for a port that is built in."""
    if not _BY_PLUGGING_ORDER.fullmatch(port):
        return None
    names = [
        name for name in port_names(root) if _at(name, root).resolve() == _at(port, root).resolve() and name != port
    ]
    remedy = f"write port: {names[0]}" if names else "write its name in /dev/serial/by-id, or install the udev rules"
    return doubtful(about, f"{port} is given to adapters in the order in which they are plugged in", remedy)


def allowed(about: str, port: str, root: Path) -> Finding | None:
    """Check whether this user, and the user of the service, may read and write the port."""
    device = _at(port, root)
    status = device.stat()
    group = _group_name(status.st_gid)
    mode = f"belongs to the group {group} with mode {status.st_mode & 0o777:o}"
    if not os.access(device, os.R_OK | os.W_OK):
        return wrong(about, f"{port} {mode}; this user may not use it", _join(group))
    if _BY_PLUGGING_ORDER.fullmatch(f"/dev/{device.resolve().name}") and group != _GROUP:
        return doubtful(about, f"{port} {mode}; the service may use ports of {_GROUP} only", "run scripts/install")
    return None


def free(about: str, port: str, root: Path) -> Finding | None:
    """Check whether another process that this user can inspect holds the port; None if none does.

    A pty is held by the process that created it.
    """
    device = f"/dev/{_below_dev(port, root)}"
    if device.startswith("/dev/pts/"):
        return None
    for folder in sorted((root / "proc").glob("[0-9]*")):
        with contextlib.suppress(OSError):
            if int(folder.name) != os.getpid() and any(
                str(file.readlink()) == device for file in list((folder / "fd").iterdir())
            ):
                name = (folder / "comm").read_text().strip()
                stop = f"systemctl disable --now {name}" if name in _GREEDY else f"kill {folder.name}"
                return wrong(about, f"{port} is held by {name} (process {folder.name})", f"end it: sudo {stop}")
    return None


def quick(about: str, port: str, root: Path) -> Finding | None:
    """Check an FTDI adapter's latency timer, which holds bytes back; None for other adapters."""
    timer = root / "sys/bus/usb-serial/devices" / _at(port, root).resolve().name / "latency_timer"
    try:
        ms = int(timer.read_text())
    except (OSError, ValueError):
        return None
    if ms < _LONG_MS:
        return ok(about, f"the adapter's latency timer is {ms} ms")
    observation = f"the adapter's latency timer is {ms} ms: answers wait for it, and their stamps with them"
    return doubtful(about, observation, f"run scripts/install, or until it is replugged: echo 1 | sudo tee {timer}")


def _join(group: str) -> str:
    with contextlib.suppress(KeyError, OSError):
        return f"run: sudo usermod -aG {group} {getpass.getuser()}; then log in again"
    return f"join the group {group}"


def _at(port: str, root: Path) -> Path:
    return root / port.removeprefix("/")


def _below_dev(port: str, root: Path) -> str:
    """`ttyUSB0` or `pts/3`, whatever the rig file calls it."""
    device = _at(port, root).resolve()
    dev = (root / "dev").resolve()
    return str(device.relative_to(dev)) if device.is_relative_to(dev) else device.name


def _group_name(gid: int) -> str:
    try:
        return grp.getgrgid(gid).gr_name
    except KeyError:
        return str(gid)
