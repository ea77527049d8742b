"""The languages of the page say the same things."""

import re
import string

import pytest

from analysis.apps.report.texts import LANGUAGES, Language, label, texts_of
from rigs.effects import VOCABULARY
from rigs.schema.limits import Limits


def _places(text: str) -> set[str]:
    return {name for _, name, _, _ in string.Formatter().parse(text) if name}


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_language_has_every_text_with_the_same_places(language: Language) -> None:
    english, other = texts_of("en"), texts_of(language)
    for one, its in ((english.words, other.words), (english.effects, other.effects)):
        assert one.keys() == its.keys()
        assert [key for key in one if _places(one[key]) != _places(its[key])] == []


def test_a_sentence_is_of_an_effect_that_exists() -> None:
    assert texts_of("en").effects.keys() <= set(VOCABULARY)


@pytest.mark.parametrize("language", ["de", "ko"])
def test_what_can_have_a_limit_has_a_label_in_each_language(language: Language) -> None:
    texts = texts_of(language)
    names = {name for test in ("yaw", "radial", "repeatability") for name in type(getattr(Limits(), test)).model_fields}
    assert [name for name in names if texts.label(name) == label(name)] == []


FIRST = {"en": r"\bfirst\b", "de": r"\bzuerst\b", "ko": r"먼저"}


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_sentences_of_an_act_have_the_order_of_the_work(language: Language) -> None:
    """To check the plate first was the last sentence of an act, after the base was fastened and the frame taught."""
    acts = {key: text for key, text in texts_of(language).words.items() if key.startswith(("act_", "check_act_"))}
    first = {key for key, text in acts.items() if re.search(FIRST[language], text, re.IGNORECASE)}
    assert {"check_act_base_or_plate", "act_load_unwritten", "act_load_targets_unwritten"} <= first
    assert [key for key in first if not re.search(FIRST[language], acts[key].partition(". ")[0], re.IGNORECASE)] == []
