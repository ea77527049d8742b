"""The head of a report: serial number, customer, order and operator, as text; and the page as a PDF."""

import re
import sys
from dataclasses import replace
from unittest import mock

import pytest

from analysis import evaluate_runs, load_run
from analysis.apps.report.html_page import check_pdf_output, write_pdf
from analysis.apps.report.page.write_page import PageHead, gather, rendered, write_page
from analysis.apps.report.texts import texts_of
from rigs.distribution import to_install
from rigs.errors import CellError
from rigs.load import load
from tests.support import command_line
from tests.support.refusals import refused
from tests.support.store_cases import edit_manifest
from tests.support.written_runs import write_simulated

RIG, TEXT = load("ur10e-cell")
EVIL = "<b>A & B</b>"


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    text = TEXT.replace("robot:\n", "robot:\n  serial: UR-20219300\n", 1)
    (made,) = write_simulated(RIG, text, "repeatability", (None,), [1], tmp_path_factory.mktemp("runs"))
    edit_manifest(made, {"operator": "M. Kim"})
    return made


@pytest.fixture(scope="module")
def report(run):
    return gather(evaluate_runs([load_run(run)]), diagnosed=False, progress=lambda doing: None)


def fields(page: str) -> dict[str, str]:
    """The names and values at the head of the page."""
    head = page[page.index("<header>") : page.index("</header>")]
    return dict(re.findall(r"<dt>(.*?)</dt><dd>(.*?)</dd>", head))


def test_serial_number_and_operator_come_from_rig_file_and_run(report):
    assert fields(rendered(report, texts_of("en"))) == {"serial number": "UR-20219300", "measured by": "M. Kim"}


def test_given_information_is_text_and_comes_first(report):
    page = rendered(report, texts_of("de"), PageHead(serial="4", customer=EVIL, order="2026-17"))
    given = {"Seriennummer": "4", "Kunde": "&lt;b&gt;A &amp; B&lt;/b&gt;", "Auftrag": "2026-17"}
    assert fields(page) == given | {"gemessen von": "M. Kim"} and EVIL not in page


@pytest.mark.parametrize(("emulated", "imported"), [(False, False), (True, False), (False, True)])
def test_runs_that_measured_no_robot_are_called_so(report, *, emulated, imported):
    (result,) = report.results
    table = result.measured.run.manifest.table if imported else None  # the fixture's, which is simulated
    manifest = result.measured.run.manifest.model_copy(update={"table": table})
    rig = RIG.model_copy(update={"emulated": emulated})
    measured = replace(result.measured, run=replace(result.measured.run, manifest=manifest), rig=rig)
    page = rendered(replace(report, results=(replace(result, measured=measured),)), texts_of("en"))
    assert measured.is_simulated == (emulated or imported)
    assert (texts_of("en")("only_simulated") in page) == measured.is_simulated


@pytest.mark.parametrize("text", ["x" * 201, "two\nlines", "\x1b[31m"])
def test_a_field_that_is_no_line_is_refused(text):
    with refused("output.invalid"):
        PageHead(customer=text).check()


def test_pdf_without_its_library_is_one_line_with_the_remedy(run, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "weasyprint", None)
    done = command_line.ran("report", run, "-o", "monday.pdf", cwd=tmp_path)
    assert (done.returncode, list(tmp_path.iterdir())) == (CellError.exit_code, [])
    assert done.stderr.startswith("error: monday.pdf: ") and done.stderr.count("\n") == 1
    assert to_install("weasyprint") in done.stderr and "monday.html" in done.stderr


def test_a_pdf_is_written_and_holds_the_pictures(report, tmp_path):
    pytest.importorskip("weasyprint", reason="the extra pdf is not installed")
    file = write_page(report, tmp_path / "monday.pdf")
    made = file.read_bytes()
    assert made.startswith(b"%PDF") and len(made) > 20_000, "text alone has less"


def test_a_pdf_that_rig_made_is_made_again_and_no_other(tmp_path, monkeypatch):
    """WeasyPrint 70 compresses its name in a PDF, so the test cannot search for this name."""
    monkeypatch.setitem(sys.modules, "weasyprint", mock.MagicMock(name="weasyprint"))
    sys.modules["weasyprint"].HTML.return_value.write_pdf.return_value = b"%PDF-1.7\n...\n%%EOF"
    file = tmp_path / "monday.pdf"
    for _ in range(2):
        check_pdf_output(file)
        write_pdf("<p>", file)
    assert b"%%EOF\n" in file.read_bytes()
    file.write_bytes(b"%PDF-1.7\nWeasyPrint\n%%EOF\n")
    with refused("output.exists", "already exists, and was not created"):
        check_pdf_output(file)
