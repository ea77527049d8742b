"""`rig pair FIRST SECOND TOUCHES`: two arms calibrated by each other; with --plan, the touches to make."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from analysis.cli import completion
from analysis.cli.commands import app, command
from analysis.cli.console import progress_of, say, say_json, say_written
from analysis.cli.options import AsJson, Language
from rigs.errors import FileError, UseError
from rigs.text import as_argument, numbers_in

if TYPE_CHECKING:
    from analysis.apps.pair.plan_touches import PlannedTouches
    from analysis.apps.report.texts import Language
    from rigs.rig import Rig

_BASE_NUMBERS = (3, 6)


@command(app, "rig pair left.yaml right.yaml touches.csv -o calibrated")
def pair(
    first_file: Annotated[
        str,
        typer.Argument(metavar="FIRST", autocompletion=completion.rig_files, help="Rig file of the arm with the ball."),
    ],
    second_file: Annotated[
        str,
        typer.Argument(
            metavar="SECOND", autocompletion=completion.rig_files, help="Rig file of the arm with the socket."
        ),
    ],
    table: Annotated[
        Path | None,
        typer.Argument(
            metavar="[TOUCHES]", help="Table with q1_deg … of the first arm, p1_deg … of the second, and socket."
        ),
    ] = None,
    plan: Annotated[
        int | None,
        typer.Option("--plan", min=12, max=200, help="Choose so many touches instead; -o writes them; default: none."),
    ] = None,
    base: Annotated[
        str | None,
        typer.Option(
            metavar="POSE",
            help="With --plan: base of the second arm in the world of the first, x,y,z in mm, then roll,pitch,yaw in "
            "degrees; default: that of its rig file.",
        ),
    ] = None,
    simulate: Annotated[
        int | None,
        typer.Option(
            "--simulate",
            metavar="SEED",
            help="With --plan: write the joints that arms with drawn errors of usual size would report; default: the "
            "planned joints.",
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="DIR|FILE.html",
            help="Directory for both calibrated rig files, JSON and page, or the page alone; with --plan, the table; "
            "default: none.",
        ),
    ] = None,
    lang: Language = "en",
    as_json: AsJson = False,
) -> None:
    """Calibrate two arms by each other: a ball on the flange of one, a socket on the flange of the other.

    Each touch is a row with the joints of both arms. The result is a
    calibration of each arm and the transform between their bases. Rows without
    joints of the second arm are touches of sockets that are fixed in the cell.
    """
    if (plan is None) == (table is None):
        raise UseError(
            "rig pair",
            "needs both rig files, then a table of touches or --plan N",
            "see rig pair --help",
            code="usage",
        )
    for option, value in (("--base", base), ("--simulate", simulate)):
        if value is not None and plan is None:
            raise UseError(option, "is allowed only with --plan", "add --plan N")
    if plan is not None:
        (first, _), (second, _) = _two_rigs(first_file, second_file)
        _plan(first, second, (first_file, second_file), plan, base, simulate, output, as_json=as_json)
    if table is not None:
        fit_two_arms(first_file, second_file, table, output, lang, as_json=as_json)


def _two_rigs(first_file: str, second_file: str) -> tuple[tuple[Rig, str], tuple[Rig, str]]:
    from rigs.load import load

    first, second = load(first_file), load(second_file)
    if first[0].name == second[0].name:
        problem = f"has the same name as the first rig file, {first[0].name}"
        raise FileError(second_file, problem, "give each arm a unique name (key name)", code="pair.invalid")
    return first, second


def fit_two_arms(
    first_file: str, second_file: str, table: Path, output: Path | None, lang: Language, *, as_json: bool
) -> None:
    from analysis.apps.pair import pair_report
    from analysis.apps.pair.fit_pair import fit_pair, pair_of
    from analysis.apps.pair.pair_table import read_pair_table
    from analysis.apps.pair.result import result_of
    from analysis.apps.report.blocks import say_answer
    from analysis.apps.report.html_page import check_page_file, is_page, write_html
    from analysis.apps.report.texts import texts_of
    from analysis.correction.model_files import refuse_existing_rig

    (first, first_text), (second, second_text) = _two_rigs(first_file, second_file)
    page = output if output and is_page(output) else None
    directory = None if page else output
    if page:
        check_page_file(page)
    models = [directory / f"{rig.name}.yaml" for rig in (first, second)] if directory else []
    for model in models:
        refuse_existing_rig(model)
    touches = read_pair_table(table, first, second)
    with progress_of("fitting both arms"):
        fit = fit_pair(pair_of(first, second, touches, str(table)))
        result = result_of(fit)
    if as_json:
        say_json(result.to_dict())
    else:
        say_answer(pair_report.pair_answer(result, texts_of(lang)))
    written = []
    if page:
        write_html(pair_report.page_of(result, lang), page)
        written = [page]
    elif directory:
        written = pair_report.write(fit, result, (first_text, second_text), table, directory, lang)
    say_written(written)
    for model in models if result.left_mm < result.before_mm else ():
        corrections = model.with_name(f"corrections-{model.stem}")
        say(f"next: rig correct {as_argument(model)} -o {as_argument(corrections)}", err=True)


def _plan(
    first: Rig,
    second: Rig,
    files: tuple[str, str],
    count: int,
    base: str | None,
    seed: int | None,
    output: Path | None,
    *,
    as_json: bool,
) -> None:
    from analysis.apps.pair.pair_report import plan_answer
    from analysis.apps.pair.plan_touches import plan_touches
    from analysis.apps.report.blocks import say_answer
    from analysis.runs.written_files import holding, refuse_existing, write_all_new
    from rigs.schema.robot import Pose

    if seed is not None and output is None:
        raise UseError("--simulate", "needs a table to write to", "add -o touches.csv", code="usage")
    if output:
        refuse_existing(output)
    if base is not None:
        values = numbers_in(base)
        if len(values) not in _BASE_NUMBERS:
            remedy = "give X,Y,Z or X,Y,Z,ROLL,PITCH,YAW, such as 1500,0,0,0,0,180"
            raise UseError("--base", f"{base!r} is not a pose", remedy, code="usage")
        pose = Pose.model_validate({"xyz_mm": values[:3], "rpy_deg": values[3:] or (0.0, 0.0, 0.0)})
        second = second.model_copy(update={"robot": second.robot.model_copy(update={"base": pose})})
    if first.robot.base == second.robot.base:
        problem = "has its base at the same place as the first arm"
        raise FileError(
            files[1],
            problem,
            "give its base: --base X,Y,Z,ROLL,PITCH,YAW, such as 1500,0,0,0,0,180",
            code="pair.invalid",
        )
    with progress_of("choosing postures"):
        planned = plan_touches(first, second, count, " and ".join(files))
    if as_json:
        say_json(planned.to_dict())
    else:
        say_answer(plan_answer(planned))
    if output:
        content = planned.csv() if seed is None else _simulated(first, second, planned, seed)
        write_all_new(output.parent, {output.name: holding(content.encode())})
        say(f"wrote {output}", err=True)
        if seed is None:
            say("next: make these touches, and replace the joints by those that both controllers show", err=True)
        say(f"next: rig pair {' '.join(map(as_argument, files))} {as_argument(output)} -o calibrated", err=True)


def _simulated(first: Rig, second: Rig, planned: PlannedTouches, seed: int) -> str:
    from analysis.apps.pair.plan_touches import base_of, simulated_touches

    touches, state = simulated_touches(first, second, planned.table, seed)
    place = ", ".join(f"{value:z.3f}" for value in base_of(first, second, state))
    say(f"true place of the base of {second.name} in {first.name}: {place} mm", err=True)
    return type(planned)(touches, planned.expected).csv()
