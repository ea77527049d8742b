"""The pages that add an effect, a measurement and a maker, followed to the letter in a copy of the tree."""

import json
import sys

import pytest
import yaml

from tests.support.how_to import checked, commands, followed, output, reinstalled

pytestmark = pytest.mark.cpu_limit(300)  # commands and checks of a whole tree, in processes of their own
EFFECT, MEASUREMENT, MAKER = "add-an-effect.md", "add-a-measurement.md", "add-a-maker.md"
TEST_KIND = "add-a-test-kind.md"
PYTEST = (sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider")


@pytest.fixture(scope="module")
def with_effect(tmp_path_factory):
    tree = tmp_path_factory.mktemp("effect")
    return tree, followed(EFFECT, tree)


@pytest.fixture(scope="module")
def with_measurement(tmp_path_factory):
    tree = tmp_path_factory.mktemp("measurement")
    return tree, followed(MEASUREMENT, tree)


def test_a_new_effect_passes_the_checks_and_keeps_the_contract(with_effect):
    tree, files = with_effect
    checked(tree, files)
    contract = "tests/rigs/test_effect_contract.py::test_every_effect_keeps_the_contract"
    chosen = "gauge_bow and not in_a_plan"  # the commands of the page plan with it
    assert "8 passed" in output(
        tree,
        *PYTEST,
        "-m",
        "nightly or not nightly",
        "-k",
        chosen,
        "tests/rigs/test_gauge_bow.py",
        "tests/rigs/test_effect_names.py",
        contract,
    )


@pytest.mark.nightly  # half a minute of processor time; that it keeps the contract is shown in each commit
def test_a_new_effect_goes_through_every_command_of_the_page(with_effect):
    tree, _ = with_effect
    said = output(tree, "bash", "-ec", commands(EFFECT, "rig diagnose"))
    assert " gauge g1" in " ".join(said.split())
    (fitted,) = yaml.safe_load((tree / "bow" / "fitted.yaml").read_text())["effects"]
    assert (fitted["effect"], fitted["gauge"]) == ("gauge_bow", "g1")
    found, *_ = json.loads((tree / "bow" / "found" / "diagnosis.json").read_text())["effects"]
    assert found["name"] == "gauge_bow g1" and found["remedy"].startswith("g1 is bent")
    for size in (fitted["relative_per_mm"], found["parameters"]["relative_per_mm"]["value"]):
        assert size == pytest.approx(0.1, abs=0.005)
    corrected = json.loads(output(tree, "rig", "correct", "bow/found/paper-fanuc.yaml", "-o", "bow/again", "--json"))
    assert "cannot correct" in corrected["effects"][0]["reason"]


def test_a_new_measurement_passes_the_checks_and_its_tests(with_measurement):
    tree, files = with_measurement
    checked(tree, files)
    assert "4 passed" in output(tree, *PYTEST, "tests/analysis/procedures/shared/test_second_order.py")


@pytest.mark.nightly  # a figure of a test with stops goes through fewer commands in each commit
def test_a_new_figure_comes_with_its_uncertainty_out_of_every_command(with_measurement):
    tree, _ = with_measurement
    said = output(tree, "bash", "-ec", commands(MEASUREMENT, "rig report"))
    assert "second order, amplitude" in said and '"second_order_deg"' in said
    runs = sorted(str(path) for path in (tree / "orders" / "runs").iterdir())
    for found in json.loads(output(tree, "rig", "analyse", *runs, "--json"))["runs"]:
        figure = found["figures"]["second_order_deg"]
        assert figure["unit"] == "deg" and 0 < figure["u"] < figure["value"]


def test_new_figure_with_stops_has_label_and_u(with_measurement):
    tree, _ = with_measurement
    said = output(tree, "bash", "-ec", commands(MEASUREMENT, "--test repeatability"))
    assert "drift" in said
    (run,) = (tree / "stops").iterdir()
    (found,) = json.loads(output(tree, "rig", "analyse", str(run), "--json"))["runs"]
    drift = found["figures"]["drift_mean_mm"]
    assert drift["unit"] == "mm" and abs(drift["value"]) < 4 * drift["u"]


@pytest.mark.nightly  # half a minute; in each commit the maker of the page is installed as a package, and writes
def test_a_new_maker_passes_the_checks_and_drives_corrects_and_enters(tmp_path):
    files = followed(MAKER, tmp_path)
    reinstalled(tmp_path)
    checked(tmp_path, files)
    tests = ("tests/analysis/apps/makers/test_acme.py", "tests/analysis/apps/programs/test_paths.py")
    assert "26 passed" in output(tmp_path, *PYTEST, "-m", "nightly or not nightly", "-k", "acme", *tests)
    output(tmp_path, "lint-imports", "--no-cache", "--contract", "makers")
    said = output(tmp_path, "bash", "-ec", commands(MAKER, "rig correct"))
    assert "56 targets" in said


def test_a_new_test_kind_passes_the_checks_and_its_commands(tmp_path):
    files = followed(TEST_KIND, tmp_path)
    reinstalled(tmp_path)
    checked(tmp_path, files)
    assert "3 passed" in output(tmp_path, *PYTEST, "tests/analysis/procedures/test_height.py")
    said = output(tmp_path, "bash", "-ec", commands(TEST_KIND, "rig import"))
    assert "height_rms_mm" in said and '"height_band_mm": {' in said
    output(tmp_path, "rig", "report", "heights/monday", "-o", "page.html")
    assert "height" in (tmp_path / "page.html").read_text()
    assert "height" in output(tmp_path, "rig", "fleet", "heights")
