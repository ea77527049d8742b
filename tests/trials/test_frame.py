from argparse import Namespace
from collections.abc import Iterator, Sequence
from typing import Any

import pytest

from tests.support.trial import Trial, main, seeds


def draw(given: Namespace) -> Iterator[int]:
    yield from (seed * given.times for seed in seeds(given))


def judge(case: int) -> dict[str, Any]:
    return {"square": case**2}


def report(done: Sequence[dict[str, Any]]) -> str:
    return f"sum {sum(one['square'] for one in done)}"


def is_large(done: Sequence[dict[str, Any]]) -> bool:
    return any(one["square"] > 50 for one in done)


TRIAL = Trial(draw, judge, report, failed=is_large, count=3, seed=1, keeps=True,
              options={"times": (1, "factor"), "ways": (("a", "b"), "ways", ("a", "b"))})  # fmt: skip


@pytest.mark.parametrize(
    ("words", "total", "code"),
    [([], 14, 0), (["2"], 5, 0), (["--cases", "2", "--first", "5"], 61, 0), (["--times", "3"], 126, 1),
     (["--jobs", "2"], 14, 0), (["--minutes", "0"], 0, 0)],
)  # fmt: skip
def test_options_decide_cases_and_the_exit_code(words, total, code, capsys):
    assert main(TRIAL, words) == code
    assert capsys.readouterr().out.splitlines()[-1] == f"sum {total}"


def test_results_of_a_file_are_not_judged_again(tmp_path, capsys):
    file = str(tmp_path / "kept.jsonl")
    main(TRIAL, ["2", "--json", file])
    judged = []
    again = Trial(draw, lambda case: judged.append(case) or judge(case), report, count=3, seed=1, keeps=True,
                  options=TRIAL.options)  # fmt: skip
    main(again, ["3", "--json", file])
    assert judged == [3]
    assert capsys.readouterr().out.endswith("sum 14\n")


@pytest.mark.parametrize("words", [["--ways", "c"], ["--times", "x"], ["many"]])
def test_a_wrong_word_is_refused(words):
    with pytest.raises(SystemExit) as end:
        main(TRIAL, words)
    assert end.value.code == 2


def test_ctrl_c_prints_partial_results(capsys):
    def interrupted(given: Namespace) -> Iterator[int]:
        yield 2
        raise KeyboardInterrupt

    main(Trial(interrupted, judge, report), [])
    assert capsys.readouterr().out.endswith("sum 4\n")
