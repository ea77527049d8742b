"""What is plugged in and what answers, for `rig init`: serial gauges, Modbus units, robots.

It only reads. A port is listened to first; then each known protocol is tried with its own read request and with nothing
else: what a conversation opens with, such as the command that makes a sensor stream, is left out unless a person has
named the instrument. Hosts are those that a person names.
"""

from daq.discovery.attempts import named_attempts
from daq.discovery.reports import FoundGauge, PortReport, RobotReport
from daq.discovery.robots import joints_of, search_robot
from daq.discovery.search import Wanted, search
from daq.discovery.watch import Watch, pushed

__all__ = [
    "FoundGauge",
    "PortReport",
    "RobotReport",
    "Wanted",
    "Watch",
    "joints_of",
    "named_attempts",
    "pushed",
    "search",
    "search_robot",
]
