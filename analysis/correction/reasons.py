"""Reasons for targets of a program that stay uncorrected."""

from __future__ import annotations

from typing import Literal

Reason = Literal[
    "relative",
    "computed",
    "not_literal",
    "handed",
    "array",
    "arc",
    "arc_turns",
    "changed",
    "offset",
    "displaced",
    "tracked",
    "external_tcp",
    "coordinated",
    "switched",
    "selected",
    "not_understood",
    "unused",
    "external_axes",
    "other_robot",
    "incomplete",
    "no_scale",
    "several_frames",
    "unknown_tool",
    "unknown_frame",
    "no_posture",
    "ambiguous",
    "other_flags",
    "two_postures",
    "past_singularity",
    "unreachable",
    "beyond_limits",
    "singular",
    "too_large",
    "changes_flags",
]
