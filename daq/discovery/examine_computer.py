"""Examination of the computer: disk, clock, service manager and serial ports, of which none is opened.

`root` is the root of the system tree, which a test can build.
"""

from __future__ import annotations

import contextlib
import ctypes
import getpass
import grp
import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path

from daq import clock
from daq.discovery.cell_finding import CellFinding, FindingVerdict, doubtful, ok, wrong
from daq.wire.serial_port import port_names

_GB = 1e9
_LITTLE_GB, _TOO_LITTLE_GB = 5.0, 0.5
_SLOW_S, _TOO_SLOW_S = 0.1, 5.0
"""Limits for the duration of a sync: the daemon syncs every 0.5 s, and the watchdog waits for 15 s."""
_SYNCS = 5
_BLOCK = bytes(1 << 16)
_ANSWERS_S = 10.0
_TIME_ERROR = 5
"""Result of adjtimex(2): the clock is not synchronised."""
_UNIT_PROPERTIES = "LoadState,ActiveState,SubState,Result,NRestarts,UnitFileState"


def examine_computer(runs: Path, unit: str | None) -> Iterator[CellFinding]:
    try:
        place = next(path for path in (runs, *runs.parents) if path.is_dir())
        yield check_free_space(runs, shutil.disk_usage(place).free / _GB)
        yield check_sync_time(runs, slowest_sync_s(place))
    except PermissionError:
        remedy = "run the command as the owner: sudo -u rig rig doctor …"
        yield doubtful("disk", f"{runs}: this user has no write permission", remedy)
    except OSError as error:
        yield wrong("disk", f"{runs}: {error.strerror or error}", "repair the disk, or choose a different --runs")
    timex = ctypes.create_string_buffer(256)  # larger than struct timex; a zero in the first member requests no change
    yield check_wall_clock(int(ctypes.CDLL(None).adjtimex(timex)))
    if unit and (properties := unit_properties(unit)):
        yield check_service(unit, properties)


def check_free_space(runs: Path, free_gb: float) -> CellFinding:
    observation = f"{free_gb:.1f} GB free for {runs}"
    if free_gb < _TOO_LITTLE_GB:
        return wrong("disk", observation, "free some space; a full disk ends a recording")
    if free_gb < _LITTLE_GB:
        return doubtful("disk", observation, "free some space before a long recording")
    return ok("disk", observation)


def check_sync_time(runs: Path, slowest_s: float) -> CellFinding:
    observation = f"writing 64 kB to the disk took up to {slowest_s * 1e3:.0f} ms"
    if slowest_s > _TOO_SLOW_S:
        return wrong("disk", observation, f"put {runs} on a separate disk, not on a memory card or a network drive")
    if slowest_s > _SLOW_S:
        return doubtful("disk", observation, "find other programs that write to the disk: iostat -x 1")
    return ok("disk", observation)


def check_wall_clock(state: int) -> CellFinding:
    if state != _TIME_ERROR:
        return ok("clock", "synchronised by NTP")
    observation = "not synchronised by NTP: the start time of a run may be wrong (readings use a different clock)"
    return doubtful("clock", observation, "run: sudo timedatectl set-ntp true")


def check_service(unit: str, properties: Mapping[str, str]) -> CellFinding:
    if properties.get("LoadState") != "loaded":
        return doubtful(unit, "not installed", "install the package of rig (docs/service.md)")
    active, sub = properties.get("ActiveState", ""), properties.get("SubState", "")
    restarts = int(properties.get("NRestarts") or 0)
    if active == "failed":
        remedy = f"find the cause with rig logs; then: sudo systemctl restart {unit}"
        return wrong(unit, f"failed ({properties.get('Result')})", remedy)
    if sub == "auto-restart" or active == "activating":
        return wrong(unit, f"does not start, after {restarts} attempts", "see why: rig logs")
    if active != "active":
        return doubtful(unit, "stopped", f"start the service: sudo systemctl enable --now {unit}")
    observation = f"running, restarted {restarts} times"
    if properties.get("UnitFileState") != "enabled":
        return doubtful(unit, f"{observation}; not started at boot", f"run: sudo systemctl enable {unit}")
    return doubtful(unit, observation, "see why: rig logs") if restarts else ok(unit, observation)


def slowest_sync_s(folder: Path) -> float:
    with tempfile.TemporaryFile(dir=folder) as file:
        taken = []
        for _ in range(_SYNCS):
            began = clock.now_s()
            file.write(_BLOCK)
            file.flush()
            os.fsync(file.fileno())
            taken.append(clock.now_s() - began)
    return max(taken)


def unit_properties(unit: str) -> dict[str, str]:
    """Systemd properties of a unit; empty if systemd is not running or does not respond."""
    if not Path("/run/systemd/system").is_dir() or not shutil.which("systemctl"):
        return {}
    command = ["systemctl", "show", f"--property={_UNIT_PROPERTIES}", unit]
    try:
        shown = subprocess.run(  # noqa: S603 - a list, no shell
            command, capture_output=True, text=True, check=False, timeout=_ANSWERS_S
        ).stdout
    except subprocess.TimeoutExpired:
        return {}
    return dict(line.split("=", 1) for line in shown.splitlines() if "=" in line)


_BY_PLUGGING_ORDER = re.compile(r"/dev/tty(USB|ACM)\d+")
_GREEDY = ("ModemManager", "brltty")
"""Programs that open new serial ports automatically."""
_GROUP = "dialout"
_LONG_MS = 2


def examine_port(about: str, port: str, root: Path, *, served: bool) -> Iterator[CellFinding]:
    """Findings about a serial port up to the first defect. served: rigd may have opened the port."""
    checks = (check_exists, check_name, *(() if served else (check_access, check_use)), check_latency)
    for check in checks:
        if finding := check(about, port, root):
            yield finding
            if finding.verdict is FindingVerdict.WRONG:
                return


def check_exists(about: str, port: str, root: Path) -> CellFinding:
    if _at(port, root).exists():
        return ok(about, f"{port} exists")
    ports = ", ".join(port_names(root)) or "none"
    remedy = f"connect the device and switch it on, or correct the port; available ports: {ports}"
    return wrong(about, f"{port}: the port does not exist", remedy)


def check_name(about: str, port: str, root: Path) -> CellFinding | None:
    """Check that the name of a port belongs permanently to the adapter."""
    if not _BY_PLUGGING_ORDER.fullmatch(port):
        return None
    real = _at(port, root).resolve()
    names = [name for name in port_names(root) if _at(name, root).resolve() == real and name != port]
    remedy = f"write port: {names[0]}" if names else "use the name in /dev/serial/by-id, or install the udev rules"
    return doubtful(about, f"{port} depends on the order in which adapters are connected", remedy)


def check_access(about: str, port: str, root: Path) -> CellFinding | None:
    """Check that this user and the user of the service may read and write the port."""
    device = _at(port, root)
    status = device.stat()
    try:
        group = grp.getgrgid(status.st_gid).gr_name
    except KeyError:
        group = str(status.st_gid)
    mode = f"belongs to the group {group} with mode {status.st_mode & 0o777:o}"
    if not os.access(device, os.R_OK | os.W_OK):
        remedy = f"join the group {group}"
        with contextlib.suppress(KeyError, OSError):
            remedy = f"run: sudo usermod -aG {group} {getpass.getuser()}; then log in again"
        return wrong(about, f"{port} {mode}; this user has no access", remedy)
    if _BY_PLUGGING_ORDER.fullmatch(f"/dev/{device.resolve().name}") and group != _GROUP:
        observation = f"{port} {mode}; the service has access only to ports of {_GROUP}"
        return doubtful(about, observation, "install the package of rig, which contains the udev rules")
    return None


def check_use(about: str, port: str, root: Path) -> CellFinding | None:
    """Check for other processes using the port, as far as this user sees them."""
    real, dev = _at(port, root).resolve(), (root / "dev").resolve()
    device = f"/dev/{real.relative_to(dev) if real.is_relative_to(dev) else real.name}"
    if device.startswith("/dev/pts/"):  # the process that created a pty uses it
        return None
    for folder in sorted((root / "proc").glob("[0-9]*")):
        with contextlib.suppress(OSError):
            files = list((folder / "fd").iterdir()) if int(folder.name) != os.getpid() else []
            if any(str(file.readlink()) == device for file in files):
                name = (folder / "comm").read_text().strip()
                stop = f"systemctl disable --now {name}" if name in _GREEDY else f"kill {folder.name}"
                return wrong(about, f"{port} is in use by {name} (process {folder.name})", f"end it: sudo {stop}")
    return None


def check_latency(about: str, port: str, root: Path) -> CellFinding | None:
    timer = root / "sys/bus/usb-serial/devices" / _at(port, root).resolve().name / "latency_timer"
    try:
        ms = int(timer.read_text())
    except (OSError, ValueError):
        return None
    if ms < _LONG_MS:
        return ok(about, f"the adapter's latency timer is {ms} ms")
    observation = f"the adapter's latency timer is {ms} ms: answers and their timestamps are delayed"
    remedy = f"install the package of rig; or, until the adapter is reconnected: echo 1 | sudo tee {timer}"
    return doubtful(about, observation, remedy)


def _at(port: str, root: Path) -> Path:
    return root / port.removeprefix("/")
