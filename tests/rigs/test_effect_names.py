import pytest

from rigs.effect_names import kind_in_words, name_in_words, names_in_words
from rigs.effects import VOCABULARY

_FIELDS = {"link_geometry": (" a", " alpha", " beta", " d")}


@pytest.mark.parametrize("kind", VOCABULARY)
def test_every_kind_has_words(kind):
    for field in _FIELDS.get(kind, ("",)):
        assert "_" not in kind_in_words(f"{kind}{field}")


def test_a_kind_is_listed_once_with_all_its_seats():
    names = ["link_bending 4", "backlash 1", "link_bending 1", "link_geometry 1.alpha", "link_geometry 6.d"]
    bending, play, twist, offset = names_in_words(names).split("; ")
    assert bending.endswith("links 1 and 4") and play.endswith("axis 1")
    assert twist.endswith("alpha of axis 1") and offset.endswith("axis 6")
    base, wrist, _ = names_in_words(["base_yields xy", "base_yields x", "wrist_coupling 4>6", "time_lag"]).split("; ")
    assert base.endswith("(about x, between x and y)") and wrist.endswith("(4 to 6)")


def test_label_keeps_the_order_of_a_gear_and_an_unknown_name():
    assert name_in_words("transmission_error 5 order 2").endswith(" 2 waves per turn")
    assert name_in_words("stranger 3") == "stranger 3"
