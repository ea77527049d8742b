"""What is plugged in and what answers, for `rig init`: serial gauges, Modbus units, robots.

It only reads, and opens only the ports that a person names. A port is listened to first; then each known protocol is
tried with its own read request and with nothing else: what a conversation opens with, such as the command that makes
a sensor stream, is left out unless a person has named the instrument. What a robot's port is sent is in `robots`.
"""

from daq.discovery.attempts import FoundGauge, PortReport, RobotReport, named_attempts
from daq.discovery.robots import ADDRESSES, joints_of, search_robot
from daq.discovery.search import Wanted, ports_here, search
from daq.discovery.watch import Watch, pushed

__all__ = [
    "ADDRESSES",
    "FoundGauge",
    "PortReport",
    "RobotReport",
    "Wanted",
    "Watch",
    "joints_of",
    "named_attempts",
    "ports_here",
    "pushed",
    "search",
    "search_robot",
]
