"""Where what is known of an interface comes from, and how far it can be trusted; `rig interfaces` lists it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Standing = Literal["confirmed", "weak", "unconfirmed"]
"""confirmed: read in the maker's manual or public code, or seen on a wire. weak: second-hand. unconfirmed: believed."""


@dataclass(frozen=True)
class Origin:
    """What an interface speaks to, and why it is believed to speak so.

    instruments: makers and models, for a person. source: manual and page, public code, or a capture. standing: of the
    whole conversation. doubts: what of it is not confirmed, in words; empty where everything is.
    """

    instruments: str
    source: str
    standing: Standing
    doubts: str = ""
