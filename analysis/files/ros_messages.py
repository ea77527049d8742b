"""The messages of ROS 2 that rig reads, taken from CDR: their layout is fixed, where a general reader would build code
from the text of definitions in a file that somebody else made.

Sources: OMG DDSI-RTPS 2.3, 10 (CDR), and ros2/common_interfaces, sensor_msgs, geometry_msgs and std_msgs.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

JOINT_STATE, NUMBER, TF = "sensor_msgs/msg/JointState", "std_msgs/msg/Float64", "tf2_msgs/msg/TFMessage"
NO_STAMP = 0


class Cdr:
    """A serialised message: the encapsulation header of four bytes, then fields, each at a multiple of its size.
    Reading beyond its end raises struct.error or IndexError."""

    def __init__(self, data: bytes) -> None:
        self._body = data[4:]
        self._order = "<" if data[1] & 1 else ">"
        self._at = 0

    def take(self, code: str, count: int = 1) -> tuple[float, ...]:
        """Take so many numbers of a format of `struct`."""
        size = struct.calcsize(code)
        self._at += -self._at % size if count else 0
        values = struct.unpack_from(f"{self._order}{count}{code}", self._body, self._at)
        self._at += size * count
        return values

    def count(self) -> int:
        """Take the length of what follows; no more than there is."""
        return min(int(self.take("I")[0]), len(self._body))

    def text(self) -> str:
        """Take a text."""
        size = self.count()
        (held,) = struct.unpack_from(f"{size}s", self._body, self._at)
        self._at += size
        return str(held.rstrip(b"\0"), "utf-8", "replace")

    def header(self) -> int:
        """Take a header: its stamp in ns, 0 for none."""
        seconds, nanoseconds = (int(one) for one in self.take("I", 2))
        self.text()
        return seconds * 10**9 + nanoseconds


def joint_state(data: bytes) -> tuple[int, dict[str, float]]:
    """Return the stamp in ns and the angle in rad of each joint of a JointState."""
    message = Cdr(data)
    stamp_ns = message.header()
    names = [message.text() for _ in range(message.count())]
    positions = message.take("d", message.count())
    return stamp_ns, dict(zip(names, positions, strict=False))


def number(data: bytes) -> float:
    """Return the number of a Float64."""
    return float(Cdr(data).take("d")[0])


class Placed(NamedTuple):
    """A place in m and a turn as a quaternion x, y, z, w, empty for a message without; child: the frame that is placed,
    where the message names it."""

    stamp_ns: int
    child: str
    place_m: tuple[float, ...]
    turn: tuple[float, ...]


def _point(data: bytes) -> Iterator[Placed]:
    message = Cdr(data)
    yield Placed(message.header(), "", message.take("d", 3), ())


def _pose(data: bytes) -> Iterator[Placed]:
    message = Cdr(data)
    yield Placed(message.header(), "", message.take("d", 3), message.take("d", 4))


def _transform(data: bytes) -> Iterator[Placed]:
    message = Cdr(data)
    yield Placed(message.header(), "", (message.text(), message.take("d", 3))[1], message.take("d", 4))


def _transforms(data: bytes) -> Iterator[Placed]:
    message = Cdr(data)
    for _ in range(message.count()):
        yield Placed(message.header(), message.text(), message.take("d", 3), message.take("d", 4))


PLACED: Mapping[str, Callable[[bytes], Iterator[Placed]]] = {
    "geometry_msgs/msg/PointStamped": _point,
    "geometry_msgs/msg/PoseStamped": _pose,
    "geometry_msgs/msg/PoseWithCovarianceStamped": _pose,
    "geometry_msgs/msg/TransformStamped": _transform,
    TF: _transforms,
}
"""What places something, by the type of the message; all but TF place one thing a topic."""
