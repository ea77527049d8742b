"""The background by Woodbury's identity beside the dense covariance; columns without what else is free."""

from __future__ import annotations

import numpy as np
import pytest
from cells import healthy

from analysis.diagnose.candidates import Candidate, candidates_for
from analysis.diagnose.evidence import Background, Dictionary
from rigs.effects import Backlash, Compliance, JointOffset, LinkGeometry, ReversalSpike, one_sided

RNG = np.random.default_rng(2)
N = 40
B, MORE, X = RNG.normal(size=(N, 7)), RNG.normal(size=(N, 3)), RNG.normal(size=(N, 4))


@pytest.mark.parametrize("more", [MORE, MORE[:, :0]])
def test_a_background_is_the_dense_covariance(more: np.ndarray) -> None:
    found = Background(B).beside(more)
    dense = np.eye(N) + B @ B.T + more @ more.T
    inverse = np.linalg.inv(dense)
    assert found.logdet == pytest.approx(np.linalg.slogdet(dense)[1])
    np.testing.assert_allclose(found.product(X, X[:, :2]), X.T @ inverse @ X[:, :2])
    np.testing.assert_allclose(found.weighted(X), inverse @ X)
    np.testing.assert_allclose(found.weighted(X[:, 0]), inverse @ X[:, 0])
    np.testing.assert_allclose(found.spread, np.diag(dense) - 1)


def test_a_background_stays_what_it_was_when_more_stands_beside_it() -> None:
    found = Background(B)
    before = found.logdet
    found.beside(MORE)
    assert found.logdet == before


def test_sigma_is_that_of_a_healthy_size_whatever_size_the_column_was_taken_at() -> None:
    linear = healthy()
    length = LinkGeometry(axis=4, field="d", delta=0.2)
    small = length.model_copy(update={"delta": 0.004})
    found = Dictionary(linear, [Candidate("d", (length,)), Candidate("d", (small,), (), 1.0, 0.02)])
    assert found.sigma[1] == pytest.approx(found.sigma[0], rel=0.01)
    assert found.sigma[0] == pytest.approx(np.linalg.norm(linear.columns([length])), rel=1e-6)


def test_own_is_the_share_that_no_set_up_does() -> None:
    linear = healthy()
    offsets = [Candidate(f"joint_offset {k}", (JointOffset(axis=k, offset_deg=0.02),)) for k in (1, 3)]
    own = Dictionary(linear, offsets).own
    assert own[0] < 0.02 < own[1] <= 1


def test_a_healthy_arm_has_a_level_of_every_limit_and_never_more_than_is_healthy() -> None:
    linear = healthy()
    effects = [Backlash(axis=1, width_deg=0.01), JointOffset(axis=3, offset_deg=0.02)]
    found = Dictionary(linear, [Candidate("b", (effects[0],), (), 0.5), Candidate("j", (effects[1],))])
    low = found.background(0.1)
    np.testing.assert_allclose(low * found.sigma / [0.5, 1.0], [0.7, 0.7])
    np.testing.assert_allclose(found.background(1e6), [0.5, 1.0])


def test_widths_and_softness_have_one_sign() -> None:
    assert one_sided(Backlash(axis=1)) and one_sided(Compliance(axis=2))
    assert not one_sided(JointOffset(axis=1)) and not one_sided(ReversalSpike(axis=1))


def test_every_candidate_is_told_by_its_name_and_seen_at_a_size() -> None:
    linear = healthy()
    candidates = candidates_for(linear)
    names = {candidate.name for candidate in candidates}
    assert {"backlash 1", "joint_offset 5", "link_geometry 5.a", "wrist_coupling 4>5", "time_lag"} <= names
    assert len(names) > 60
    sized = [one for one in candidates if one.name == "backlash 1"]
    assert len({one.effect for one in sized}) == len(sized) > 1
