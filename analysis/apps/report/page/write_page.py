"""The page as a single HTML file without requests.

A Content-Security-Policy allows only its two scripts, by SHA-256. The plotting script (`scripts/dev plotting_script`)
is embedded compressed, and the browser unpacks it.
"""

from __future__ import annotations

import base64
import datetime as dt
import gzip
import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from importlib import resources
from pathlib import Path
from typing import Any, get_args

import numpy as np
from markupsafe import Markup

from analysis.api import RigError, diagnose
from analysis.apps.report.act_words import without_idle_mounts
from analysis.apps.report.blocks import Block, Cell, Command, Heading, Row, Sentence, Table, paragraphs
from analysis.apps.report.chart import ROLE_STYLES, Picture, live, still
from analysis.apps.report.diagnosis_answer import Sections, sections_of, stairs_of, step_sentences, summary_parts
from analysis.apps.report.html_page import environment, is_pdf, write_html, write_pdf
from analysis.apps.report.model_charts import residual_charts, simulated_charts
from analysis.apps.report.page.accuracy import (
    BeforeAfter,
    PageVerdict,
    example_limits,
    judge,
    limits_blocks,
    now_blocks,
    path_blocks,
    verdict_blocks,
)
from analysis.apps.report.pose_charts import NO_POSES, PoseModel
from analysis.apps.report.run_answer import columns_of, doubt_lines, doubts_of, figure_table, remarks_of
from analysis.apps.report.run_charts import circle_charts, joint_chart, target_charts
from analysis.apps.report.summary_words import summarise
from analysis.apps.report.texts import Language, Texts, capital, joined, texts_of
from analysis.correction.model_files import calibration_file
from analysis.diagnosis.judge.acts import CORRECTED, Act, ActiveCorrection, open_acts
from analysis.diagnosis.judge.comparison import Compared, PoseComparison, compare
from analysis.diagnosis.judge.result import Diagnosis
from analysis.procedures.circle import CircleResult
from analysis.procedures.pose import PoseResult
from analysis.procedures.results import Result, by_test
from analysis.procedures.shared.joint_reversals import angle_difference, turns
from analysis.runs.tables import format_of
from rigs.distribution import version
from rigs.errors import FileError, UseError
from rigs.rig import Rig
from rigs.schema.probe import Certificate
from rigs.schema.vocabulary import TestName

_ORDER = get_args(TestName)
_MOST_DRAWN = 2
"""Browsers show at most some sixteen rotatable charts."""
_NOMINAL_DEG = 30.0
"""Largest distance between a measured reversal and the nominal reversal of the same sense."""


TestSection = tuple[list[Block], list[Picture], list[Block]]
"""Blocks before the pictures of a test at a place, the pictures, and the blocks after them."""
_ON_SHEET = (
    "band_deg",
    "circular_deviation_mm",
    "hysteresis_max_deg",
    "hysteresis_max_mm",
    "band_mm",
    "uni_mm",
    "bi_mm",
)
"""Figures of the first page: what a ballbar sheet shows of a circle (ISO 230-4), and the bands of other tests."""


def test_sections(
    groups: Sequence[Sequence[Result]],
    simulated: Compared | None,
    corrected: Compared | None,
    texts: Texts,
    poses: PoseModel = NO_POSES,
) -> list[TestSection]:
    """corrected: runs compared with the model including the found parts."""
    first_circle = next((group for group in groups if isinstance(group[0].found, CircleResult)), None)
    sections = []
    for group in groups:
        about, charts = texts.words.get(f"about_{group[0].test}", ""), list[Picture]()
        if isinstance(group[0].found, CircleResult):
            charts += circle_charts(group, texts)
        else:
            charts += [chart for result in group[:_MOST_DRAWN] for chart in target_charts(result, texts, poses)]
            about += f" {texts('first_drawn', count=_MOST_DRAWN)}" if len(group) > _MOST_DRAWN else ""
        charts += simulated_charts(simulated, corrected, group, texts)
        charts += [joint_chart(group, texts)] if group is first_circle else []  # yaw and roll share one circle
        place = group[0].measured.run.manifest.placement
        title = texts.test(group[0].test) + (f" · {place}" if place and place != group[0].test else "")
        doubts = paragraphs(doubt_lines(doubts_of(group)), "doubt")
        above: list[Block] = [Heading(title), Sentence(about), *doubts]
        sections.append((above, charts, _below(group, texts)))
    return sections


def sheet_of_first(groups: Sequence[Sequence[Result]], sections: Sequence[TestSection], texts: Texts) -> TestSection:
    """Both directions of the first circle in polar form with their figures, or the first picture of another test, with
    the arm of poses.

    The pictures move from their section to the first page.
    """
    if not groups:
        return [], [], []
    _, pictures, _ = sections[0]
    chosen: list[Picture] = [picture for picture in pictures if picture.frame == "polar"] or pictures[:1]
    chosen += [picture for picture in pictures[1:] if picture.frame == "arm"][:1]
    for picture in chosen:
        pictures.remove(picture)
    columns = [
        replace(column, figures={name: column.figures[name] for name in _ON_SHEET if name in column.figures}, below={})
        for column in columns_of(groups[0], texts)
    ]
    shown = [column for column in columns if column.figures]
    return [Heading(texts.test(groups[0][0].test), 3)], chosen, [figure_table(shown, texts)] if shown else []


def _below(group: Sequence[Result], texts: Texts) -> list[Block]:
    words = " ".join(f"{capital(line)}." for line in remarks_of(group))
    figures = figure_table(columns_of(group, texts), texts)
    return [Heading(texts("figures"), 3), figures, Sentence(words, "note"), *_reversals(group[0], texts)]


def _reversals(result: Result, texts: Texts) -> list[Block]:
    if not isinstance(result.found, CircleResult):
        return []
    rows = []
    for turn in sorted(turns(result.found.laps), key=lambda turn: turn.phi):
        near = {
            abs(np.degrees(angle_difference(turn.phi, np.radians(reversal.phi_deg)))): f"{reversal.phi_deg:.1f}°"
            for reversal in result.reversals
            if (reversal.joint, reversal.upper) == (turn.axis, turn.upper)
        }
        away_deg = min(near, default=np.inf)
        nominal = near[away_deg] if away_deg < _NOMINAL_DEG else ""
        joint, measured = texts.axis(result.measured.rig.robot, turn.axis), f"{np.degrees(turn.phi):.1f}°"
        rows.append((joint, measured, nominal, texts("upper" if turn.upper else "lower")))
    table = Table([*map(texts, ("joint", "turns_at", "nominal", "sense"))], rows, {1, 2}, key="narrow stack")
    return [Heading(texts("reversals"), 3), Sentence(texts("about_reversals")), table] if rows else []


_LONGEST = 200
"""Characters of a field; more is an accidental paste."""


@dataclass(frozen=True)
class Report:
    """rig: model and limits. corrected: runs compared with the model and the found parts. undiagnosed: reason for a
    missing diagnosis. left_out: errors of runs that could not be evaluated.
    """

    rig: Rig
    results: tuple[Result, ...]
    simulated: Compared | None
    corrected: Compared | None
    found: Diagnosis | None
    undiagnosed: str
    left_out: tuple[str, ...]
    after: BeforeAfter | None = None
    """Measured effect of a correction."""
    poses: PoseModel = NO_POSES
    """Errors of poses that remain with the best model."""

    @property
    def title(self) -> str:
        return f"{self.results[0].measured.rig.name} – {self.rig.robot.name}"


def gather(
    results: Sequence[Result],
    rig: Rig | None = None,
    *,
    diagnosed: bool = True,
    diagnosis: Diagnosis | None = None,
    left_out: Sequence[RigError] = (),
    after: BeforeAfter | None = None,
    progress: Callable[[str], None],
) -> Report:
    """Compare and diagnose evaluated runs, or state why this is impossible.

    diagnosis: an existing one; diagnosed: whether to make one. Raises FileError for runs of several robots.
    """
    runs = [result.measured for result in results]
    model = rig if rig is not None else runs[0].rig
    # Two robots of one type differ in rig names; the model may come from a separate rig file
    for run in runs:
        if run.rig.robot.name != model.robot.name and rig is not None:
            problem = f"is of {run.rig.robot.name}, but --rig describes {model.robot.name} (rig {model.name})"
            raise FileError(str(run.path), problem, "give the rig file of this robot, or no --rig", code="robot.other")
        if (run.rig.robot.name, run.rig.name) != (model.robot.name, runs[0].rig.name):
            about = f"the report is about rig {runs[0].rig.name} of {runs[0].rig.robot.name}"
            problem = f"is of rig {run.rig.name} of {run.rig.robot.name}, but {about}"
            raise FileError(str(run.path), problem, "make a report for each robot", code="robot.other")
    undiagnosed = ""
    if diagnosis is None and diagnosed:
        try:
            diagnosis = diagnose(runs, rig=model, progress=progress)
        except RigError as error:
            undiagnosed = str(error)
    progress("simulating the runs")
    simulated, corrected, best = _compared(results, model), None, model
    if diagnosis is not None and diagnosis.calibrated is not None:
        best = diagnosis.extended_rig.with_calibration(
            calibration_file("found.calibration.json", diagnosis.calibrated.content), diagnosis.calibrated
        )
        corrected = _compared(results, best)
    held_out = diagnosis.held_out.rows if diagnosis and diagnosis.held_out else {}
    return Report(
        model, tuple(results), simulated, corrected, diagnosis, undiagnosed, tuple(map(str, left_out)), after,
        PoseModel(_pose_errors(results, best), held_out),
    )  # fmt: skip


def _compared(results: Sequence[Result], rig: Rig) -> Compared | None:
    """None if the runs cannot be simulated, such as poses."""
    runs = [result.measured for result in results if format_of(result.measured.table.test).gauges]
    try:
        return compare(runs, rig) if runs else None
    except RigError:
        return None


def _pose_errors(results: Sequence[Result], rig: Rig) -> tuple[PoseComparison, ...]:
    """Errors of poses with a model that has effects; none if they cannot be simulated."""
    runs = [result.measured for result in results if isinstance(result.found, PoseResult)]
    try:
        return compare(runs, rig).poses if runs and (rig.effects or rig.calibrated) else ()
    except RigError:
        return ()


@dataclass(frozen=True)
class PageHead:
    serial: str = ""
    customer: str = ""
    order: str = ""

    def check(self) -> None:
        for name, text in vars(self).items():
            if len(text) > _LONGEST:
                raise UseError(
                    f"--{name}", f"has {len(text)} characters", f"write at most {_LONGEST}", code="output.invalid"
                )
            if not text.isprintable():
                raise UseError(f"--{name}", "contains control characters", "write one line", code="output.invalid")


NO_HEAD = PageHead()


def fields_of(heading: PageHead, results: Sequence[Result], texts: Texts) -> list[tuple[str, str]]:
    """Name and value of the fields of the head. The serial number comes from the runs, since the model may be of
    another robot.
    """
    serials = dict.fromkeys(result.measured.rig.robot.serial for result in results)
    operators = dict.fromkeys(result.measured.run.manifest.operator for result in results)
    fields = {
        "serial": heading.serial or ", ".join(filter(None, serials)),
        "customer": heading.customer,
        "order": heading.order,
        "operator": ", ".join(filter(None, operators)),
    }
    return [(texts(name), value) for name, value in fields.items() if value]


def trace_table(results: Sequence[Result], texts: Texts) -> Table:
    rows = []
    for result in results:
        manifest = result.measured.run.manifest
        by = f"{texts('by')} {manifest.operator}" if manifest.operator else ""
        software = ", ".join(f"{name} {version}" for name, version in manifest.software.items())
        source = manifest.table.file if manifest.table else ""
        who = (joined([by, manifest.host], ", "), software, source)
        files = [f"{texts('rig_file')} {manifest.rig_sha256}"]
        files += [f"{chunk.file} {chunk.sha256}" for chunk in manifest.chunks]
        started = Cell(manifest.started[:19].replace("T", " "), who)
        rows.append((Cell(result.title, (result.name,)), started, Cell(str(result.measured.path), files)))
    return Table([*map(texts, ("run", "when_and_who", "files"))], rows, key="stack")


def instruments_table(rig: Rig, texts: Texts) -> Table:
    rows = list[Row]()
    for name, gauge in rig.gauges:
        stated = (texts("certificate_missing"), f"{gauge.calibrated or '–'}", "–")
        rows.append((name, gauge.interface, *(_certificate(gauge.certificate) if gauge.certificate else stated)))
    others = {"ball": rig.ball, "link": rig.link}
    rows += [(name, "", *_certificate(part)) for name, part in others.items() if part]
    heads = ("instrument", "kind", "certificate", "calibrated", "due")
    return Table([*map(texts, heads)], rows, key="narrow stack")


def _certificate(certificate: Certificate) -> tuple[str, str, str]:
    return certificate.number, f"{certificate.date}", f"{certificate.due or '–'}"


def write_page(report: Report, file: Path, language: Language = "en", heading: PageHead = NO_HEAD) -> Path:
    """Write HTML, or PDF by the suffix. An existing file stays until the new one is complete."""
    write = write_pdf if is_pdf(file) else write_html
    write(rendered(report, texts_of(language), heading), file)
    return file


def rendered(report: Report, texts: Texts, heading: PageHead = NO_HEAD) -> str:
    found, after = report.found, report.after
    stairs = stairs_of(found, texts) if found else None
    groups = sorted(by_test(report.results), key=lambda group: _ORDER.index(group[0].test))
    sections = test_sections(groups, report.simulated, report.corrected, texts, report.poses)
    sheet = sheet_of_first(groups, sections, texts)
    gaps = residual_charts(found, stairs, texts) if found else []
    verdict = judge(report.results, report.rig.limits, found)
    corrected = after.verdict if after and after.verdict and after.verdict.judged else None
    days = sorted(result.measured.run.manifest.started[:10] for result in report.results)
    span = days[0] if days[0] == days[-1] else f"{days[0]} – {days[-1]}"
    parts = {}
    if found:
        acts, instead = _divided_acts(found, after)
        parts = sections_of(found, texts, acts, instead=instead, corrected=bool(after and after.driven))
    badge, (head, *tiles) = _summary(report, corrected or verdict, texts)
    standing = texts(f"standing_{(corrected or verdict).overall}")
    template = environment().get_template("report.html")
    return template.render(
        t=texts,
        title=report.title,
        standing=f"{texts('corrected_now')} {standing}" if corrected else standing,
        measured_on=texts.counted("measured_on", len(days), days=span),
        heading=fields_of(heading, report.results, texts),
        condition_badge=badge,
        head=head,
        tiles=tiles,
        sheet=sheet,
        condition=_condition(report, badge, parts, texts),
        accuracy=_accuracy(after, verdict, texts),
        findings=_findings(report, verdict, parts, texts),
        path=path_blocks(after, texts) if after else [],
        parts=parts,
        steps=step_sentences(stairs, texts) if stairs else [],
        gaps=gaps,
        limits=limits_blocks(verdict, texts, "limits_before" if after and after.driven else "limits"),
        sections=sections,
        still=lambda picture: f"data:image/svg+xml;base64,{base64.b64encode(still(picture).encode()).decode()}",
        trace=_trace(report, texts),
        simulated_only=all(result.measured.is_simulated for result in report.results),
        style=_template("report.css"),
        **_scripts([picture for _, drawn, _ in [sheet, *sections] for picture in drawn] + list(gaps)),
    )


def _condition(report: Report, badge: Sentence, parts: Sections, texts: Texts) -> list[Block]:
    why = joined([texts("undiagnosed"), report.undiagnosed]) if report.undiagnosed else texts("not_diagnosed")
    sentences = parts.get("details", [])[1:] if report.found else [Sentence(why, "strong")]
    return [Heading(texts("condition"), 3), badge, *sentences]


def _accuracy(after: BeforeAfter | None, verdict: PageVerdict, texts: Texts) -> list[Block]:
    now = now_blocks(after, texts) if after and after.driven else []
    return [Heading(texts("accuracy"), 3), *now, verdict_blocks(verdict, texts, texts("was_before") if now else "")]


def _findings(report: Report, verdict: PageVerdict, parts: Sections, texts: Texts) -> list[list[Block]]:
    acts, after, limits = parts.get("acts", []), report.after, list[Block]()
    if acts and after and after.driven:
        acts = [*acts, Sentence(texts(f"after_cause_{after.way}"))]
    if verdict.overall == "unjudged" and (example := example_limits(verdict)):
        has_data_sheet = report.rig.limits.data_sheet_rp_mm is not None
        about = joined([texts("example_limits"), texts("or_repeatability") if has_data_sheet else ""])
        limits = [Sentence(about), Command(example)]
    return [blocks for blocks in (acts, parts.get("faults", []), limits) if blocks]


def _summary(report: Report, verdict: PageVerdict, texts: Texts) -> tuple[Sentence, list[list[Block]]]:
    if report.found is None:
        return Sentence("", "unjudged", texts("badge_not_examined")), [[]]
    summary = (report.after and report.after.summary) or summarise(report.found, texts)
    head, error, *tiles = summary_parts(replace(summary, causes=summary.sheet_causes), texts)
    within = "" if verdict.overall == "unjudged" else texts(f"within_{verdict.overall}")
    within = texts("verdict_tolerance") if verdict.by_tolerance else within
    accuracy = f"{texts('accuracy')}: {texts(f'standing_{verdict.overall}')}"
    error[-1] = Sentence(joined([within, summary.error.basis]), verdict.overall, accuracy)
    return Sentence("", summary.tone, summary.badge), [head, error, *tiles]


def _trace(report: Report, texts: Texts) -> list[Block]:
    made = dt.datetime.now(dt.UTC).strftime("%Y-%m-%d %H:%M UTC")
    return [
        Heading(texts("trace")),
        trace_table(report.results, texts),
        *(Sentence(f"left out: {error}", "doubt") for error in report.left_out),
        instruments_table(report.rig, texts),
        Sentence(texts("made", version=version(), written=made), "note"),
    ]


def _divided_acts(diagnosis: Diagnosis, after: BeforeAfter | None) -> tuple[Sequence[Act], Sequence[Act]]:
    """Acts to do, and acts that would only replace the correction with which the robot drives."""
    acts = without_idle_mounts(diagnosis.acts)
    if after is None or after.driven is None or after.way == "none":
        return open_acts(acts, None, elsewhere=bool(after and after.joined))
    corrected = after.driven[1]
    to_do, instead = open_acts(acts, ActiveCorrection(after.way, corrected.um, corrected.u_um), elsewhere=True)
    is_enough = after.verdict is None or after.verdict.overall != "fail"
    return ([CORRECTED, *to_do] if is_enough else to_do), instead


def _scripts(pictures: Sequence[Picture]) -> dict[str, Any]:
    """Scripts and chart data of the page, and the hashes for the browser."""
    packed = (resources.files("analysis") / "templates" / "plotly.min.js.gz").read_bytes()
    script = _template("report.js")
    places = {id(picture): f"p{number}" for number, picture in enumerate(pictures)}
    drawn = {
        "pictures": {places[id(picture)]: live(picture) for picture in pictures},
        "looks": {role: asdict(style) for role, style in ROLE_STYLES.items()},
    }
    return {
        "script": script,
        "script_hashes": Markup(f"{_hash(script)} {_hash(gzip.decompress(packed).decode())}"),  # noqa: S704 - base64 of a hash
        "plotly": base64.b64encode(packed).decode(),
        "data": base64.b64encode(gzip.compress(json.dumps(drawn).encode(), 9, mtime=0)).decode(),
        "place": lambda picture: places[id(picture)],
    }


def _hash(script: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}'"


def _template(name: str) -> Markup:
    text = (resources.files("analysis") / "templates" / name).read_text(encoding="utf-8")
    return Markup(text)  # noqa: S704 - a file of this package
