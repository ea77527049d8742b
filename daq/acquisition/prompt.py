"""How readers stamp promptly beside the other threads of the daemon, of which one at a time runs Python.

Two things hold a reader up that has just been woken by its bytes. A thread that computes gives way only when it is
asked to, after the interpreter's switch interval. And no thread runs while Python's collector visits all objects; those
that the daemon starts with, its libraries above all, are some hundred thousand and never garbage.
"""

from __future__ import annotations

import gc
import sys

_SWITCH_S = 0.0001
"""A fiftieth of Python's default, and some ten times what a reader needs before it waits again: so the switches
themselves cost little."""


def keep_stamps_prompt() -> None:
    """Set this process up for readers; call it once everything is loaded."""
    sys.setswitchinterval(_SWITCH_S)
    gc.collect()
    gc.freeze()
