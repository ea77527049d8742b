from typing import Any

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from analysis.diagnosis import diagnose as module
from rigs.load import load


def blas_threads() -> set[int]:
    return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}


def test_a_diagnosis_uses_one_blas_thread_and_restores_the_number_after_an_error(monkeypatch):
    class StopError(Exception):
        pass

    def seen(*arguments: Any) -> None:
        raise StopError(blas_threads())

    monkeypatch.setattr(module, "gather", seen)
    with threadpool_limits(limits=2, user_api="blas"):
        with pytest.raises(StopError) as stopped:
            module.diagnose(load("ur10e")[0], [], [], [], print)
        assert stopped.value.args == ({1},) and blas_threads() == {2}
