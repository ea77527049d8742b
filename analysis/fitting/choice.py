"""The effects that a person asks to be fitted: `joint_offset,link_geometry:3.a,backlash:1,transmission_error:4:2`.

A name alone stands for all axes, or for both gauges. Waves come as two halves, a sine and a cosine, so that every phase
can be reached.
"""

from __future__ import annotations

import re
from itertools import product
from typing import Any

from rigs.effects import VOCABULARY, Effect, healthy_size, one_sided, size_field
from rigs.errors import FileError

_NUMBER = r"\d+(?:\.\d+)?"
_PLACES = {
    "link_geometry": (r"(?:(?P<axis>[1-6])(?:\.(?P<field>a|alpha|d|beta))?)?", "link_geometry:3.a"),
    "transmission_error": (rf"(?:(?P<axis>[1-6])(?::(?P<order>{_NUMBER}))?)?", "transmission_error:4:2 (axis:order)"),
    "wrist_coupling": (r"(?P<from_axis>[1-6])\.(?P<to_axis>[1-6])", "wrist_coupling:4.5 (from.to)"),
    "ball_form": (r"(?P<lobes>\d+)", "ball_form:3 (lobes)"),
    "vibration": (rf"(?P<frequency_hz>{_NUMBER})", "vibration:8.5 (Hz)"),
    "gauge_cyclic": (rf"(?P<gauge>g[12]):(?P<period_mm>{_NUMBER})", "gauge_cyclic:g1:0.5 (gauge:period in mm)"),
}
"""How a place is written, by effect; the others take an axis, a gauge or nothing."""
_EVERY = {"axis": "123456", "gauge": ("g1", "g2"), "field": ("a", "alpha", "d"), "order": "12"}
"""What a place left out stands for. Hayati's beta is one more than four parameters a joint need; gears begin with an
eccentric wheel and twice that."""


def chosen(words: str) -> list[Effect]:
    """The effects of a list, each once, bounded ones at half a healthy size. Raises FileError for what is none."""
    found: dict[str, Effect] = {}
    for word in filter(None, map(str.strip, words.split(","))):
        for effect in _expanded(word):
            found.setdefault(repr(effect), effect)
    if not found:
        raise FileError("--fit", "names no effect", "write --fit joint_offset,backlash:1, say")
    return list(found.values())


def _expanded(word: str) -> list[Effect]:
    name, _, place = word.partition(":")
    if name not in VOCABULARY:
        raise FileError(f"--fit {word}", "no such effect", f"one of {', '.join(VOCABULARY)}")
    pattern, written = _place(name)
    match = re.fullmatch(pattern, place, re.ASCII)
    if not match:
        raise FileError(f"--fit {word}", f"{place!r} is no place of {name}", f"write {written}")
    keys = {key: (value,) if value is not None else tuple(_EVERY[key]) for key, value in match.groupdict().items()}
    if "phase_deg" in VOCABULARY[name].model_fields:
        keys["phase_deg"] = ("0", "90")
    return [_begun(word, name, dict(zip(keys, values, strict=True))) for values in product(*keys.values())]


def _place(name: str) -> tuple[str, str]:
    """Pattern of the places of an effect, and how one is written."""
    fields = VOCABULARY[name].model_fields
    if "axis" in fields:
        return _PLACES.get(name, (r"(?P<axis>[1-6])?", f"{name}:1"))
    if "gauge" in fields:
        return _PLACES.get(name, (r"(?P<gauge>g[12])?", f"{name}:g1"))
    return _PLACES.get(name, ("", name))


def _begun(word: str, name: str, keys: dict[str, Any]) -> Effect:
    """An effect to begin a fit with: at zero, or, where it cannot be negative, at half a healthy size."""
    try:
        effect: Any = VOCABULARY[name].model_validate(keys)
    except ValueError:
        raise FileError(f"--fit {word}", f"outside what {name} can be", "see docs/simulation.md") from None
    begun: Effect = effect.model_copy(
        update={size_field(effect): 0.5 * healthy_size(effect) if one_sided(effect) else 0.0}
    )
    return begun
