"""The catalogue of texts: one snapshot of its English, and the same keys and values in every language.

`UPDATE_SNAPSHOT=1 pytest tests/analysis/apps/report/test_texts.py` accepts new wordings.
"""

import os
import string
from pathlib import Path
from typing import get_args

import pytest

from analysis.apps.report.diagnosis_answer import sections_of
from analysis.apps.report.summary_words import summarise
from analysis.apps.report.texts import capital, joined, keys_of, texts_of
from analysis.diagnosis.judge.result import Condition
from rigs.schema.limits import Limits
from tests.support.every import in_every_language
from tests.support.handmade_diagnosis import diagnosis

SNAPSHOT = Path(__file__).with_name("catalogue.txt")


def places_in(text: str) -> set[str]:
    return {name for _, name, _, _ in string.Formatter().parse(text) if name}


def test_the_english_texts_are_those_of_the_snapshot():
    texts = texts_of("en")
    found = {condition: diagnosis(condition) for condition in get_args(Condition)}
    lines = [f"{key}: {text}" for key, text in texts.words.items()]
    for condition, one in found.items():
        summary = summarise(one, texts)
        lines += ["", f"== {condition}", f"{summary.badge}: {summary.headline}", *summary.unknowns]
        lines += [summary.error.title, summary.error.words, summary.error.basis, summary.next]
        lines += [block.text for name in ("details", "acts") for block in sections_of(one, texts)[name][1:]]
    text = "\n".join(lines) + "\n"
    if os.environ.get("UPDATE_SNAPSHOT"):
        SNAPSHOT.write_text(text)
    assert SNAPSHOT.read_text() == text


@in_every_language
def test_a_language_has_every_text_with_the_same_places(language):
    english, other = texts_of("en").words, texts_of(language).words
    assert english.keys() == other.keys()
    assert [key for key in english if places_in(english[key]) != places_in(other[key])] == []


@pytest.mark.parametrize("language", ["de", "ko"])
def test_every_figure_with_a_limit_has_a_label(language):
    texts = texts_of(language)
    names = {name for test in ("yaw", "radial", "repeatability") for name in type(getattr(Limits(), test)).model_fields}
    assert [name for name in names if texts.label(name) == texts_of("en").label(name)] == []


def test_texts_keep_the_keys_of_the_texts_inserted_into_them():
    texts = texts_of("en")
    inner = texts("axis_numbered", axis=2)
    outer = joined([capital(texts("part_curve", joint=inner)), "", texts("do_next")])
    assert keys_of(outer) == ("part_curve", "axis_numbered", "do_next") and keys_of("plain") == ()
    assert outer[0].isupper() and inner in outer
