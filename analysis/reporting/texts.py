"""The fixed texts in a language: `analysis/templates/texts.LANGUAGE.yaml`, the same keys in each.

The page has them in its language, screen and picture in English. What the analysis says in words of its own, as doubts
and remedies, stays English.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Literal, get_args

import yaml

from analysis.reporting.labels import label
from rigs.schema.robot import Robot

Language = Literal["en", "de", "ko"]
LANGUAGES: tuple[Language, ...] = get_args(Language)


@dataclass(frozen=True)
class Texts:
    """The words by key, the labels of figures by name, a sentence for each kind of effect, and what an effect is called
    within a sentence, where this language does not call it as the effect itself does."""

    language: Language
    words: dict[str, str]
    labels: dict[str, str]
    effects: dict[str, str]
    nouns: dict[str, str]

    def __call__(self, key: str, **values: object) -> str:
        """A text with values in its places."""
        return self.words[key].format(**values)

    def test(self, name: str) -> str:
        """What a test is called; one that another package adds, by its word."""
        return self.words.get(f"test_{name}", name)

    def not_known(self, share: float) -> str:
        """The sentence about the share of the work at which no run says how well the arm is known, after a space; empty
        where there is none."""
        key = "work_unknown_all" if share == 1 else "work_unknown"
        return f" {self(key, share=f'{max(100 * share, 1):.0f} %')}" if share else ""

    def axis(self, robot: Robot, axis: int) -> str:
        """What an axis, counted from 1, is called: `axis 4 (gamma)`."""
        name = robot.own_name(axis)
        return self("axis_of", axis=axis, name=name) if name else self("axis_numbered", axis=axis)

    def label(self, name: str) -> str:
        """The label of a figure, the English one where this language has none."""
        return self.labels.get(name) or label(name)


@cache
def texts_of(language: Language) -> Texts:
    """The texts of a language."""
    file = resources.files("analysis") / "templates" / f"texts.{language}.yaml"
    read = yaml.safe_load(file.read_text(encoding="utf-8"))
    return Texts(language, read["words"], read["labels"], read["effects"], read["nouns"])
