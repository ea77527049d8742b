"""The fixed texts of each language, from `analysis/templates/texts.LANGUAGE.yaml`, and labels and order of the figures.

All languages have the same keys. The page uses the selected language; screen and picture use English. Sentences
composed by the analysis, such as doubts and remedies, stay English.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Literal, get_args

import yaml

from rigs.schema.robot import Robot

LEADING = frozenset({"band_deg", "band_mm", "uni_mm", "bi_mm", "rms_mm", "radius_mm", "line_at_mm"})
"""Figures printed in bold: the ones the paper reports."""

_LABELS = {
    "band_deg": "error band",
    "max_at_deg": "  largest at φ",
    "min_at_deg": "  smallest at φ",
    "amplitude_deg": "sine amplitude r",
    "shift_deg": "sine shift α",
    "offset_deg": "sine offset A",
    "eccentricity_mm": "eccentricity",
    "eccentricity_u_mm": "  along u (φ = 0°)",
    "eccentricity_v_mm": "  along v (φ = 90°)",
    "range_deg": "range with the sine",
    "range_max_at_deg": "  largest at φ",
    "range_min_at_deg": "  smallest at φ",
    "distance_eccentricity_mm": "eccentricity by distance",
    "distance_eccentricity_u_mm": "  along u (φ = 0°)",
    "distance_eccentricity_v_mm": "  along v (φ = 90°)",
    "circular_deviation_mm": "circular deviation G",
    "hysteresis_mean_deg": "hysteresis, mean",
    "hysteresis_max_deg": "hysteresis, largest",
    "hysteresis_max_at_deg": "  at φ",
    "hysteresis_mean_mm": "hysteresis of the distance, mean",
    "hysteresis_max_mm": "hysteresis of the distance, H",
    "radius_mm": "least-squares sphere, radius",
    "centre_x_mm": "  centre x from the ball",
    "centre_y_mm": "  centre y from the ball",
    "centre_z_mm": "  centre z from the ball",
    "band_mm": "error band about the sphere",
    "held_radius_mm": "radius, centre fixed",
    "held_band_mm": "error band, centre fixed",
    "spread_mm": "range over orientations, largest",
    "spread_mean_mm": "range over orientations, mean",
    "uni_mm": "uni-directional range",
    "uni_mean_mm": "  mean over targets",
    "bi_mm": "bi-directional range",
    "bi_mean_mm": "  mean over targets",
    "ap_mm": "accuracy AP (ISO 9283)",
    "ap_mean_mm": "  mean",
    "rp_mm": "repeatability RP (ISO 9283)",
    "rp_mean_mm": "  mean",
    "r_out_mm": "R↓ from outside (ISO 230-2)",
    "r_in_mm": "R↑ from inside (ISO 230-2)",
    "r_mm": "bi-directional R (ISO 230-2)",
    "reversal_mm": "reversal value |B|, largest",
    "reversal_mean_mm": "reversal value B, mean",
    "rms_mm": "position error, rms",
    "mean_mm": "  mean",
    "max_mm": "  largest",
    "rms_deg": "orientation error, rms",
    "max_deg": "  largest",
    "spat_mm": "single-point articulation, 2 s (ASME B89.4.22)",
    "socket_distance_mm": "distance of the sockets, by an arm without error",
    "repeat_mm": "scatter of one coordinate",
    **{f"{figure}_p{k}_mm": f"{figure.upper()} of P{k}" for k in range(1, 6) for figure in ("ap", "rp")},
    "ad_mm": "distance accuracy AD, P2 to P4",
    "rd_mm": "distance repeatability RD",
    "line_at_mm": "path accuracy AT, line (ISO 9283)",
    "line_rt_mm": "path repeatability RT, line",
    "circle_at_mm": "AT, large circle",
    "circle_rt_mm": "RT, large circle",
    "small_circle_at_mm": "AT, small circle",
    "small_circle_rt_mm": "RT, small circle",
    "corner_round_mm": "cornering round-off CR",
    "corner_overshoot_mm": "corner overshoot CO",
    "f_max_mm": "radial deviation F, largest (ISO 230-4)",
    "f_min_mm": "radial deviation F, smallest",
    "d_mm": "mean radial deviation D, both directions",
    "speed_mm_s": "speed along the path",
    **{
        f"axis{axis}_{figure}_deg": f"axis {axis}, {text}"
        for axis in range(1, 8)
        for figure, text in (("bidirectional", "bidirectional deviation E"), ("reversal", "reversal (play)"))
    },
    **{f"friction_j{axis}_a": f"friction of axis {axis}" for axis in range(1, 7)},
    **{
        f"{figure}_{angle}_deg": f"{text} {figure.upper()} {angle}, about {axis}"
        for figure, text in (("ap", "accuracy"), ("rp", "repeatability"))
        for angle, axis in zip("abc", "xyz", strict=True)
    },
}


def in_order(names: Iterable[str]) -> list[str]:
    """Return distinct figure names in the order of the labels, details below their main line; unknown names last."""
    place = {name: k for k, name in enumerate(_LABELS)}
    return sorted(dict.fromkeys(names), key=lambda name: place.get(name, len(place)))


def label(name: str) -> str:
    """Return the label of a figure in a table. Details are indented below their main line; figures without a label
    keep the name.
    """
    return _LABELS.get(name, name)


def whole_label(name: str, label: Callable[[str], str] = label) -> str:
    """Return the label of a figure outside a table, a detail after the main line: `position error, largest`."""
    text_of_figure, above = label(name).strip(), ""
    for known_name, text in _LABELS.items():
        above = above if text.startswith(" ") else known_name
        if known_name == name:
            break
    if not label(name).startswith(" "):
        return text_of_figure
    # The place of the largest value is a detail of that line; a mean belongs to the rms.
    of = label(above) if name.endswith("_at_deg") else label(above).partition(", ")[0]
    return f"{of}, {text_of_figure}"


Language = Literal["en", "de", "ko"]
LANGUAGES: tuple[Language, ...] = get_args(Language)


class Phrase(str):
    """A text of the catalogue that knows its key, the keys of the texts inserted into it, and the values."""

    __slots__ = ("keys", "values")
    keys: tuple[str, ...]
    values: Mapping[str, object]

    def __new__(cls, text: str, keys: tuple[str, ...] = (), values: Mapping[str, object] | None = None) -> Phrase:
        sentence = super().__new__(cls, text)
        sentence.keys, sentence.values = keys, values or {}
        return sentence

    def __getnewargs__(self) -> tuple[str, tuple[str, ...]]:  # type: ignore[override]
        return str(self), self.keys


def keys_of(text: object) -> tuple[str, ...]:
    """Return the keys of the texts from which a text was made."""
    return text.keys if isinstance(text, Phrase) else ()


def capital(text: str) -> Phrase:
    """Return a text with a capital first letter, and its keys."""
    return Phrase(f"{text[:1].upper()}{text[1:]}", keys_of(text))


def joined(texts: Iterable[str], by: str = " ") -> Phrase:
    """Join the texts that are not empty, and keep their keys."""
    shown = [text for text in texts if text]
    return Phrase(by.join(shown), tuple(key for text in shown for key in keys_of(text)))


@dataclass(frozen=True)
class Texts:
    """Texts by key, labels of figures by name, and nouns for effects.

    nouns contains only the effects whose standard name this language replaces.
    """

    language: Language
    words: dict[str, str]
    labels: dict[str, str]
    nouns: dict[str, str]

    def __call__(self, key: str, **values: object) -> Phrase:
        """Return a text with values inserted."""
        keys = (key, *(inner for value in values.values() for inner in keys_of(value)))
        return Phrase(self.words[key].format(**values), keys, values)

    def counted(self, key: str, count: int, **values: object) -> str:
        """Return the text for a count, in the singular if the language has one for 1."""
        singular = f"{key}_single"
        return self(singular if count == 1 and singular in self.words else key, count=count, **values)

    def test(self, name: str) -> str:
        """Return the name of a test; for a test of an external package, the identifier."""
        return self.words.get(f"test_{name}", name)

    def not_known(self, share: float) -> str:
        """Return the sentence about the share of the work with unknown accuracy, after a space; empty for 0."""
        key = "work_unknown_all" if share == 1 else "work_unknown"
        return f" {self(key, share=f'{max(100 * share, 1):.0f} %')}" if share else ""

    def axis(self, robot: Robot, axis: int) -> str:
        """Return the name of an axis, counted from 1: `axis 4 (gamma)`."""
        name = robot.own_name(axis)
        return self("axis_of", axis=axis, name=name) if name else self("axis_numbered", axis=axis)

    def label(self, name: str) -> str:
        """Return the label of a figure, in English if this language has none."""
        return self.labels.get(name) or label(name)


@cache
def texts_of(language: Language) -> Texts:
    """Return the texts of a language."""
    file = resources.files("analysis") / "templates" / f"texts.{language}.yaml"
    read = yaml.safe_load(file.read_text(encoding="utf-8"))
    return Texts(language, read["words"], read["labels"], read["nouns"])
