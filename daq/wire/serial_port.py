"""Opening of serial devices with pyserial: line settings, modem lines, and remedies for failures.

Modem lines that power a cable are set before the first byte.
"""

from __future__ import annotations

import errno
import fcntl
import struct
import termios
from pathlib import Path

import serial

from rigs.errors import CellError
from rigs.schema.links import Line, ModemLines

_PLUGGED = ("ttyUSB*", "ttyACM*", "ttyXRUSB*", "rfcomm*")
_BUILT_IN = ("ttyS*", "ttyAMA*")
_LASTING = ("dev/rig", "dev/serial/by-id", "dev/serial/by-path")
_IFLAG = 0
_COUNTS = struct.Struct("@20i")
"""`struct serial_icounter_struct` of linux/serial.h, filled by `TIOCGICOUNT`."""
_PLACES = {"overrun": 7, "wrong framing": 6, "wrong parity": 8, "buffer overrun": 10}
"""Indices of the counters for lost and damaged characters."""
_TIOCGICOUNT = 0x545D
"""Value from asm-generic/ioctls.h, valid for x86 and ARM; the termios module of Python lacks it."""
_BITS = {7: serial.SEVENBITS, 8: serial.EIGHTBITS}


def port_names(root: Path = Path("/")) -> list[str]:
    """Serial ports of this computer by their most permanent names.

    Pluggable ports precede built-in ports. Names of missing hardware are omitted. root: parent of /dev and /sys.
    """
    files = [file for folder in _LASTING if (root / folder).is_dir() for file in sorted((root / folder).iterdir())]
    files += sorted(file for kind in _PLUGGED for file in (root / "dev").glob(kind))
    files += sorted(file for kind in _BUILT_IN for file in (root / "dev").glob(kind) if _has_chip(file.name, root))
    best: dict[Path, Path] = {}
    for file in files:
        best.setdefault(file.resolve(), file)
    return [f"/{file.relative_to(root)}" for file in best.values()]


def is_built_in(port: str) -> bool:
    """True if a port is part of the computer and therefore exists even if nothing is connected."""
    return any(Path(port).resolve().match(f"/dev/{kind}") for kind in _BUILT_IN)


def _has_chip(name: str, root: Path) -> bool:
    """A PC lists /dev/ttyS0 to 31, most of them lacking a chip."""
    try:
        return (root / "sys/class/tty" / name / "type").read_text().strip() != "0"  # PORT_UNKNOWN of serial_core.h
    except OSError:
        return False


def open_serial(name: str, port: str, line: Line, modem: ModemLines | None) -> serial.Serial:
    where = f"{name}, {port}"
    try:
        if not Path(port).exists():
            remedy = "connect the device, or correct the port; available ports: " + (", ".join(port_names()) or "none")
            raise CellError(where, "no such port", remedy, code="port.missing")
        device = _configured(port, line, modem)
        if line.parity != "N":
            # Report a character with wrong parity as NUL, which never occurs in a reading. By default pyserial passes
            # such a character on unchanged, and a flipped bit could turn a digit into a different digit.
            fd = device.fileno()
            settings = termios.tcgetattr(fd)
            settings[_IFLAG] |= termios.INPCK
            termios.tcsetattr(fd, termios.TCSANOW, settings)
    except serial.SerialException as error:
        text = str(error)
        if "exclusively lock" in text or "busy" in text:
            problem, remedy = "in use by a different program", "stop the other program (a different rigd, a terminal)"
        elif "Permission denied" in text:
            problem, remedy = "permission denied", "add the user to the group dialout and log in again"
        else:
            problem = f"cannot be opened as a serial port ({error.strerror or text})"
            remedy = "give the path of a serial port"
        raise CellError(where, problem, remedy, code="port.refused") from None
    except (OSError, ValueError, termios.error) as error:
        problem = f"is not a serial device ({error})"
        raise CellError(where, problem, "give the path of a serial port", code="port.missing") from None
    return device


def _configured(port: str, line: Line, modem: ModemLines | None) -> serial.Serial:
    device = serial.Serial(baudrate=line.baud, timeout=0, exclusive=True)
    if modem is not None:
        device.dtr, device.rts = modem.dtr, modem.rts
    device.port = port
    device.bytesize, device.parity, device.stopbits = _BITS[line.bits], line.parity, line.stop
    try:
        device.open()
    except termios.error as error:
        if error.args[0] != errno.EINVAL:
            raise
        # A port that has no physical line (a pty, some adapters) rejects parity; the bytes pass unchanged.
        device.bytesize, device.parity, device.stopbits = serial.EIGHTBITS, serial.PARITY_NONE, serial.STOPBITS_ONE
        device.open()
    return device


def line_errors(fd: int) -> dict[str, int]:
    """Counters of lost and damaged characters by cause.

    Empty for a pty, and for adapters with a driver that does not count.
    """
    try:
        counts = _COUNTS.unpack(fcntl.ioctl(fd, _TIOCGICOUNT, bytes(_COUNTS.size)))
    except (OSError, ValueError):
        return {}
    return {name: counts[place] for name, place in _PLACES.items()}
