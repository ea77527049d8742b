"""Rows of a report: every figure has a label, and details stand under the line that they belong to."""

from analysis.apps.report.texts import in_order, texts_of

whole_label = texts_of("en").whole_label


def test_details_stand_under_their_line_and_none_is_lost():
    names = ["shift_deg", "eccentricity_v_mm", "max_at_deg", "new_mm", "distance_eccentricity_u_mm", "band_deg"]
    names += ["eccentricity_mm", "eccentricity_u_mm", "distance_eccentricity_mm", "range_deg", "range_max_at_deg"]
    assert in_order(names) == [
        "band_deg",
        "max_at_deg",
        "shift_deg",
        "eccentricity_mm",
        "eccentricity_u_mm",
        "eccentricity_v_mm",
        "range_deg",
        "range_max_at_deg",
        "distance_eccentricity_mm",
        "distance_eccentricity_u_mm",
        "new_mm",
    ]


def test_turns_have_labels():
    for name in (f"{what}_{axis}_deg" for what in ("ap", "rp") for axis in "abc"):
        assert texts_of("en").label(name) != name


def test_figure_alone_names_what_it_details():
    assert whole_label("bi_mean_mm") == "bi-directional range, mean over targets"
    assert whole_label("uni_mean_mm") == "uni-directional range, mean over targets"
    assert whole_label("rp_mean_mm") == "repeatability RP (ISO 9283), mean"
    assert whole_label("mean_mm") == "position error, mean" and whole_label("rms_mm") == "position error, rms"
    assert whole_label("hysteresis_max_at_deg") == "hysteresis, largest, at φ"
    assert whole_label("play_2") == "play_2"
    labels = texts_of("en").labels
    assert len({whole_label(name) for name in labels}) == len(labels)
