import json

from tests.trials.reliability import judged

PLAY = {"name": "backlash 1", "parameters": {}, "posterior": 0.995, "rivals": []}
FAULT = {"name": "backlash 1", "size": "width_deg", "parameters": {"width_deg": 0.1}, "class": ["backlash 1"]}


def test_kept_cases_make_table_and_diagram(tmp_path):
    (tmp_path / "truth").mkdir()
    for number in range(3):
        case = tmp_path / "cases" / f"case-{number}"
        case.mkdir(parents=True)
        truth = {"case": case.name, "kind": "one", "seed": number, "outside": [], "background": []}
        hidden = [FAULT | {"testable": True}]
        (tmp_path / "truth" / f"{case.name}.json").write_text(json.dumps(truth | {"hidden": hidden}))
        (case / "answer.json").write_text(json.dumps({"condition": "named", "effects": [PLAY], "seconds": 2.0}))
    (tmp_path / "cases" / "case-begun").mkdir()
    said = judged(([tmp_path], tmp_path / "odds.png"))
    assert said.startswith("3 cases\n") and "3 of 3" in said
    assert (tmp_path / "odds.png").read_bytes().startswith(b"\x89PNG")
