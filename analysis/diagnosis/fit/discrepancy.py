"""Causes outside the library as free functions in addition to the named effects, and the remaining named effects."""

from __future__ import annotations

from dataclasses import replace

from analysis.diagnosis.fit.free_forms import discrepancy_evidence, discrepancy_functions
from analysis.diagnosis.fit.joint_curves import is_of_curve
from analysis.diagnosis.fit.selection import Selection
from analysis.diagnosis.fit.selection_state import SelectionState, beginnings

LEAST_STRENGTH = 1.5
"""Strength of a band above which a cause outside the library is tried. Chosen: cells with none have up to 1.2."""


def add_discrepancy(selection: Selection, state: SelectionState) -> tuple[Selection, SelectionState]:
    """Add free functions for causes outside the library, and remove the named effects that are no longer justified.

    Returns the new selection and state, or both unchanged if there is no sign of such causes. A named effect that
    imitates such a cause leaves a residual, to which the next effect is fitted. Named effects are therefore reassessed
    together with functions of every angle, direction, time and place of the ball. The readings determine the amplitude.
    """
    waves = [effect for effect in state.possible_faults(state.effects) if is_of_curve(effect)]
    is_suspect = bool(state.free_forms) or (state.strength > LEAST_STRENGTH).any() or len(waves) > 1
    if not selection.shows_free_forms or not is_suspect:
        return selection, state
    columns = selection.columns.with_discrepancy(discrepancy_functions(selection.linear))
    wider = Selection(selection.linear, columns, selection.effort)
    bare = wider.refitted(replace(state, free_forms=()))
    begins = [with_likeliest_discrepancy(wider, begun) for begun in beginnings(bare)]
    gain, foreign = wider.likeliest(begins)
    if not foreign.discrepancy or gain <= selection.evidence(state):
        return selection, state
    return wider, without_imitators(wider, wider.settled(foreign))


def with_likeliest_discrepancy(selection: Selection, state: SelectionState) -> SelectionState:
    """Return the state with the likeliest amplitude of causes outside the library in addition to the named effects,
    0 if no amplitude pays the penalty.
    """
    functions = selection.columns.X[:, selection.columns.discrepancy]
    none = replace(state, discrepancy=0.0)
    gain, amplitude = discrepancy_evidence(functions, selection.posterior(none))
    return selection.renewed(replace(none, discrepancy=amplitude)) if gain > 0 else none


def without_imitators(selection: Selection, state: SelectionState) -> SelectionState:
    """Remove the named effects that causes outside the library explain equally well: first all waves of joints
    together, which approximate any function of angles, and then single named effects.
    """
    waves = [k for k, effect in enumerate(state.effects) if is_of_curve(effect)]
    if len(waves) > 1:
        without = state
        for place in reversed(waves):
            without = selection.without(without, place)
        without = with_likeliest_discrepancy(selection, without)
        state = without if selection.evidence(without) >= selection.evidence(state) else state
    place = 0
    while place < len(state.effects):
        without = with_likeliest_discrepancy(selection, selection.without(state, place))
        if selection.evidence(without) >= selection.evidence(state):
            state = without
        else:
            place += 1
    return selection.renewed(selection.refitted(state))
