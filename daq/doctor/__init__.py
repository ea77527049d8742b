"""What is wrong with a cell, in plain words; behind `rig doctor`.

Each check is a function that gives a finding; what touches the system takes its root as an argument, or is kept apart
from what judges. Only what a conversation would send anyway is sent, and where a daemon serves the rig, the
daemon is asked and no port is touched.
"""

from daq.doctor.examine import examine
from daq.doctor.finding import Finding, Verdict
from daq.doctor.modbus_scan import scan_modbus

__all__ = ["Finding", "Verdict", "examine", "scan_modbus"]
