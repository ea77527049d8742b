import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis.diagnosis.judge.calibrated_model import _combine_calibrations
from rigs.calibration import (
    TIMES,
    CalibratedModel,
    CovarianceParameter,
    Term,
    covariance_root,
    limited_root,
    packed_factor,
)
from rigs.effects import VOCABULARY, Effect
from rigs.load import contradictions, load
from rigs.schema.effect import Payload, Scope, bounds, healthy, size_field
from tests.support import command_line
from tests.support.handmade_calibration import calibrated_model, written

SCOPE = Scope(True, ("g1", "g2"), (0, -90, 0, -90, 90, -90), (1.0,) * 6, True, Payload(4.0))
RIG = load("paper-fanuc")[0]
FORMS: list[Effect] = [
    form for cls in VOCABULARY.values() for forms in cls.forms(SCOPE) for form in forms if not hasattr(form, "rail")
]


@st.composite
def fitted(draw: st.DrawFn) -> Effect:
    form, values = healthy(draw(st.sampled_from(FORMS))), {}
    shapes = [shape.field for shape in (*form.free(Payload(4.0)), *form.STRETCHED)]
    for name in (size_field(form), *shapes):
        low, high = bounds(form, name)
        values[name] = low + draw(st.floats(0, 1)) * (high - low)
    return form.model_copy(update=values)


def model_of(effects: list[Effect], small: list[tuple[Effect, float]], log_sd: float, seed: int) -> CalibratedModel:
    terms = [Term.model_construct(effect=one, times=1.0, named=False) for one in effects]
    terms += [Term.model_construct(effect=one, times=times, named=False) for one, times in small]
    parameters = [
        CovarianceParameter(term=k, field=name)
        for k, one in enumerate(effects)
        for name in dict.fromkeys([size_field(one), *(s.field for s in (*one.free(Payload(4.0)), *one.STRETCHED))])
    ]
    parameters += [CovarianceParameter(term=len(effects) + k, field=TIMES) for k in range(len(small))]
    rng = np.random.default_rng(seed)
    factor = 10.0 ** (log_sd + rng.uniform(-3, 3, (len(parameters), 1))) * rng.normal(size=(len(parameters),) * 2)
    root = limited_root(covariance_root(factor @ factor.T), terms, parameters)
    return calibrated_model(terms=tuple(terms), parameters=tuple(parameters), factor=packed_factor(root))


@settings(max_examples=50, deadline=None)
@given(
    effects=st.lists(fitted(), max_size=3),
    before=st.lists(fitted(), max_size=2),
    small=st.lists(st.tuples(st.sampled_from(FORMS), st.floats(-20, 20)), min_size=1, max_size=4),
    log_sd=st.floats(-6, 6),
    seed=st.integers(0, 2**32 - 1),
)
def test_calibration_of_any_effects_sizes_and_uncertainties_is_read(effects, before, small, log_sd, seed):
    background = [(healthy(form), times) for form, times in small]
    model = model_of(effects, background, log_sd, seed)
    earlier = model_of(before, background, -log_sd, seed + 1)
    for one in (model, _combine_calibrations(earlier, model)):
        again = CalibratedModel.read(one.content)
        assert not list(contradictions(again, RIG))
        assert len(again.effects) <= len(one.terms)


def test_an_uncertainty_widened_beyond_the_bounds_of_an_effect_is_limited_to_them(tmp_path):
    effects = [form for form in FORMS if form.effect == "backlash"]
    small = [(healthy(form), 0.1) for form in FORMS[::4]]
    rig_file, _ = written(tmp_path, model_of(effects, small, 4.0, 1))
    rig, _ = load(rig_file)
    sd = np.linalg.norm(rig.calibrated.root, axis=1)
    assert sd[0] <= bounds(effects[0], "width_deg")[1] * (1 + 1e-6)
    for line in (
        f"check {rig_file}",
        f"correct {rig_file} -o {tmp_path}/out",
        f"export-urdf {rig_file} -o {tmp_path}/u",
    ):
        done = command_line.ran(line)
        assert done.returncode == 0, (line, done.stdout, done.stderr)
