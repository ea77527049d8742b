"""Files for a LinuxCNC controller, with which it sends the joints at the servo rate."""

from __future__ import annotations

from pathlib import Path

from daq.discovery import rigfeed

_HAL = """\
# Joints for rig at the servo rate; moves nothing. Written by rig init.
# Copy this file and rigfeed.py next to the INI file, and add there:
#   [HAL]
#   HALFILE = rig.hal
# as the last HALFILE. If a pin is already linked, halcmd names its signal: write that name in place of rig-….
# If another file loads a sampler: a single loadrt has all channels, as in cfg=…,ffffffbfs. Remove the loadrt here, and
# write sampler.1 for sampler.0 and the channel 1 in the last line.
# Joints count from 0 in LinuxCNC: joint 0 is axis 1 of rig. joint.N.pos-fb includes HOME_OFFSET; motor-pos-fb does not.
loadrt sampler depth=8000 cfg=ffffffbfs
addf sampler.0 servo-thread
{joints}
net rig-homed motion.is-all-homed => sampler.0.pin.6
# A program states its number with M68 E0 Q1
net rig-signal motion.analog-out-00 => sampler.0.pin.7
net rig-overruns sampler.0.overruns => sampler.0.pin.8
# Arguments: TCP port, channel of the sampler
loadusr /usr/bin/python3 rigfeed.py {port} 0
"""
_JOINT = "net rig-joint-{joint} joint.{joint}.pos-fb => sampler.0.pin.{joint}"


def linuxcnc_files(port: int) -> dict[str, bytes]:
    """HAL file and the program that it starts, by name. port: TCP port of the program."""
    joints = "\n".join(_JOINT.format(joint=joint) for joint in range(6))
    return {
        "rig.hal": _HAL.format(joints=joints, port=port).encode(),
        "rigfeed.py": Path(rigfeed.__file__).read_bytes(),
    }
