"""Opening a serial device with pyserial: its line settings, its modem lines, and what to do where it does not open.

pyserial has both modem lines on unless they are set otherwise. Those that a cable takes its power from are set before
the first byte.
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
"""Place of the input modes in what tcgetattr gives."""
_COUNTS = struct.Struct("@20i")
"""`struct serial_icounter_struct` of linux/serial.h: what `TIOCGICOUNT` fills in."""
_PLACES = {"overrun": 7, "wrong framing": 6, "wrong parity": 8, "no room in the port": 10}
"""Places of its counts of lost and damaged characters, by their names in a report."""
_TIOCGICOUNT = 0x545D
"""asm-generic/ioctls.h; x86 and ARM have it, and the termios of Python does not."""
_BITS = {7: serial.SEVENBITS, 8: serial.EIGHTBITS}


def port_names(root: Path = Path("/")) -> list[str]:
    """Return the serial ports of this computer, by the name to write into a rig file: one that lasts, if any.

    Those that are plugged in come first, then those that are built in; names without a chip behind them are left out.
    root: where /dev and /sys are.
    """
    files = [file for folder in _LASTING if (root / folder).is_dir() for file in sorted((root / folder).iterdir())]
    files += sorted(file for kind in _PLUGGED for file in (root / "dev").glob(kind))
    files += sorted(file for kind in _BUILT_IN for file in (root / "dev").glob(kind) if _has_chip(file.name, root))
    best: dict[Path, Path] = {}
    for file in files:
        best.setdefault(file.resolve(), file)
    return [f"/{file.relative_to(root)}" for file in best.values()]


def is_built_in(port: str) -> bool:
    """Return whether a port is part of the computer, so that it is there also where nothing is plugged into it."""
    return any(Path(port).resolve().match(f"/dev/{kind}") for kind in _BUILT_IN)


def _has_chip(name: str, root: Path) -> bool:
    """Whether a built-in port is more than a name: a PC has /dev/ttyS0 to 31, most of them without a chip."""
    try:
        return (root / "sys/class/tty" / name / "type").read_text().strip() != "0"  # PORT_UNKNOWN of serial_core.h
    except OSError:
        return False


def open_serial(name: str, port: str, line: Line, modem: ModemLines | None) -> serial.Serial:
    """Open the device of a stream. Raises CellError with the remedy. modem: None leaves both lines on."""
    where = f"{name}, {port}"
    try:
        if not Path(port).exists():
            ports = ", ".join(port_names()) or "none"
            raise CellError(where, "no such port", f"plug it in, or correct the port; ports here: {ports}")
        device = _configured(port, line, modem)
        if line.parity != "N":
            # Have the system pass on NUL, which no reading holds, for a character of wrong parity.  pyserial has
            # such a one passed on as it is: a digit of which the line turned a bit would be another digit.
            fd = device.fileno()
            settings = termios.tcgetattr(fd)
            settings[_IFLAG] |= termios.INPCK
            termios.tcsetattr(fd, termios.TCSANOW, settings)
    except serial.SerialException as error:
        text = str(error)
        if "exclusively lock" in text or "busy" in text:
            problem, remedy = "in use by another program", "stop the other program (another rigd, a terminal)"
        elif "Permission denied" in text:
            problem, remedy = "permission denied", "add the user to the group dialout and log in again"
        else:
            problem = f"cannot be opened as a serial port ({error.strerror or text})"
            remedy = "give the path of a serial port"
        raise CellError(where, problem, remedy) from None
    except (OSError, ValueError, termios.error) as error:
        raise CellError(where, f"is not a serial device ({error})", "give the path of a serial port") from None
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
        # A port without a line (a pty, some adapters) takes no parity; its bytes come as they are.
        device.bytesize, device.parity, device.stopbits = serial.EIGHTBITS, serial.PARITY_NONE, serial.STOPBITS_ONE
        device.open()
    return device


def line_errors(fd: int) -> dict[str, int]:
    """Return how many characters the port has counted as lost or damaged, by what happened to them.

    Empty where it does not count: a pty, and adapters whose driver has no such counts.
    """
    try:
        counts = _COUNTS.unpack(fcntl.ioctl(fd, _TIOCGICOUNT, bytes(_COUNTS.size)))
    except (OSError, ValueError):
        return {}
    return {name: counts[place] for name, place in _PLACES.items()}
