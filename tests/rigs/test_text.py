import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigs.text import counted, enumerated, escape_lines, escape_text, escape_values


@given(st.text())
def test_plain_text_is_printable_and_idempotent(text):
    shown = escape_text(text)
    assert shown.isprintable() and shown.encode().decode() == shown
    assert escape_text(shown) == shown
    assert text.isprintable() == (shown == text)
    assert escape_lines(text).count("\n") == text.count("\n")


def test_nothing_is_hidden():
    assert escape_text("a\x1b[2J\n\u202eb\ud800\x9b") == r"a\x1b[2J\n\u202eb\ud800\x9b"
    assert escape_text("größe µ φ ✗ 机") == "größe µ φ ✗ 机"
    assert escape_lines("a\r\nb") == "a\\r\nb"


def test_the_texts_in_json_are_plain():
    assert escape_values({"\x07": ["\n", {"a": "b"}], "n": 1.5, "no": None}) == {
        r"\x07": [r"\n", {"a": "b"}],
        "n": 1.5,
        "no": None,
    }


@pytest.mark.parametrize(("count", "words"), [(0, "0 runs"), (1, "1 run"), (2, "2 runs")])
def test_counted_nouns_have_plurals(count, words):
    assert counted(count, "run") == words
    assert counted(count, "run is", "runs are").split()[:2] == words.split()


def test_no_words_are_enumerated_as_nothing():
    assert enumerated([]) == "" and enumerated(["a", "b", "c"], "or") == "a, b or c"
