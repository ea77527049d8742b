"""Robot feedback: one interface a file, named as `interface` names it in the rig file.

Each file offers `host(feedback)`, the conversation that listens (values q1_deg … q6_deg, always all six in
that order, then `signal` where `rigs.schema.feedback.carries_signal`), and `device(feedback, read)`, the controller's
side, where `read(now_ns)` gives the same: six angles in degrees, then the signal.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import import_module

from daq.protocol.conversation import Device, Host
from rigs.schema.feedback import Feedback

Read = Callable[[int], Sequence[float]]


def host(feedback: Feedback) -> Host:
    """Return our side of the conversation."""
    conversation: Host = import_module(f"daq.feedback.{feedback.interface}").host(feedback)
    return conversation


def device(feedback: Feedback, read: Read) -> Device:
    """Return the controller's side of the conversation."""
    conversation: Device = import_module(f"daq.feedback.{feedback.interface}").device(feedback, read)
    return conversation
