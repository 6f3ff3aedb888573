from collections.abc import Callable
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.models.model import Model
from core.models.scene import Scene
from tests.conftest import random_model
from viewer.values import history as module
from viewer.values.history import History, Step
from viewer.values.state import Mix, Pair, State


@pytest.fixture
def states(model: Model) -> list[State]:
    return [State(Scene(model[0], model.camera(0.1 * n, 0)), Mix(Pair("a", "a"), "b", shape=0.1 * n)) for n in range(6)]


def test_a_gesture_is_one_step(states: list[State]) -> None:
    history = History.of(states[0])
    for state in states[1:4]:
        history = history.changed(state, "orbit")
    history = history.without_gesture().changed(states[4], "orbit").changed(states[5], "zoom")
    assert history.past == (states[0], states[3], states[4])


def test_no_change_is_no_step(states: list[State]) -> None:
    history = History.of(states[0]).changed(states[1]).undone()
    same = State(replace(states[0].scene), replace(states[0].mix))
    assert history.changed(same) is history


def test_any_state_can_be_gone_to_and_none_is_lost(states: list[State]) -> None:
    history = History.of(*states).undone()
    for index, state in enumerate(states):
        moved = history.at(index)
        assert (moved.now, len(moved.past), moved.states) == (state, index, tuple(states))
        assert moved.undone().now is states[max(0, index - 1)] and moved.redone().now is states[index:][:2][-1]


def test_edits_are_grouped_by_object_and_what_changes_no_code_is_none(states: list[State], model: Model) -> None:
    first = states[0]
    moved = replace(first, scene=replace(first.scene, camera=model.camera(1.0, 0.5)))
    other_b = replace(moved, mix=replace(moved.mix, b="c"))
    second = State(replace(first.scene, instance=model[1]), Mix(Pair("b", "b"), "c"))
    mixed = State(replace(first.scene, instance=model[2]), replace(second.mix, shape=0.5))
    back = State(first.scene, first.mix)
    history = History.of(first)
    for state in (moved, other_b, second, mixed, back):
        history = history.changed(state)
    assert [[(edit.last, edit.words) for edit in group] for group in history.edits()] == [
        [(2, "at first")],
        [(3, "b"), (4, "c mixed in: shape 50%, texture 0%")],
        [(5, "a")],
    ]


@pytest.fixture
def edited(model: Model) -> Callable[[int], State]:
    """States that differ in their codes, all from one camera."""
    return lambda number: _state(model, number, 0)


def test_a_move_from_an_earlier_state_keeps_the_later_ones(edited: Callable[[int], State], model: Model) -> None:
    history = History.of(edited(0), edited(1), edited(2)).at(0)
    for azimuth in (0.1, 0.2, 0.3):
        turned = _turned(history.now, model, azimuth)
        history = history.changed(turned, "orbit", moves=True)
    assert history.states == (edited(0), turned, edited(1), edited(2)) and history.now == turned
    assert history.redone().now == edited(1) and history.undone().now == edited(0)
    assert [[edit.words for edit in group] for group in history.edits()] == [
        ["at first", "shape and texture", "shape and texture"]
    ]


def test_an_edit_from_an_earlier_state_is_a_branch_beside_the_later_ones(edited: Callable[[int], State]) -> None:
    history = History.of(edited(0), edited(1), edited(2)).at(0).changed(edited(3))
    assert history.states == (edited(0), edited(3)) and history.future == ()
    (branch,) = history.branches()
    assert (branch.start, branch.last, branch.words) == (0, 2, "shape and texture")
    back = history.at(branch.last)
    assert back.states == (edited(0), edited(1), edited(2)) and back.now == edited(2)
    assert [branch.last for branch in back.branches()] == [3]
    assert back.undone().undone().redone().now == edited(1)  # redo stays on the path


def test_a_drag_that_begins_as_no_edit_is_a_branch_once_it_is_one(edited: Callable[[int], State]) -> None:
    history = History.of(edited(0), edited(1)).at(0)
    history = history.changed(replace(edited(0), removed=frozenset({"a"})), "key")
    assert history.future == (replace(edited(1), removed=frozenset({"a"})),)
    history = history.changed(replace(edited(2), removed=frozenset({"a"})), "key")
    assert history.steps[1].state == edited(1)
    assert history.future == () and [branch.last for branch in history.branches()] == [1]
    assert history.undone().now == edited(0)


def test_an_undone_choice_of_b_is_a_branch_but_no_undone_move_is(edited: Callable[[int], State], model: Model) -> None:
    turned = History.of(edited(0), _turned(edited(0), model, 0.5)).undone().changed(edited(1))
    assert turned.branches() == () and len(turned.steps) == 3
    other_b = replace(edited(0), mix=replace(edited(0).mix, b="c"))
    removed = replace(edited(0), removed=frozenset({"a"}))
    for changed, words in ((other_b, "c as B"), (removed, "removed objects")):
        history = History.of(edited(0), changed).undone().changed(edited(1))
        assert [(branch.last, branch.words) for branch in history.branches()] == [(1, words)]


def test_later_states_take_over_what_is_removed(edited: Callable[[int], State]) -> None:
    third = replace(edited(2), removed=frozenset({"b"}))
    history = History.of(edited(0), edited(1), third).at(0)
    history = history.changed(replace(edited(0), removed=frozenset({"a"})))
    assert [state.removed for state in history.future] == [{"a"}, {"a", "b"}]
    assert history.undone().now == edited(0)


_NO_PARENTS = (1, 2), (0, 2), (2, -1), (2, 9)  # numbers of steps, and parents that they cannot have


def test_what_is_no_tree_is_refused(edited: Callable[[int], State]) -> None:
    history = History.of(edited(0), edited(1), edited(2))
    history.check()
    steps = history.steps
    harmed = (
        replace(history, steps={}),
        replace(history, current=3),
        replace(history, tip=1),
        replace(history, tip=-4),
        *(replace(history, steps=steps | {number: Step(steps[0].state, parent)}) for number, parent in _NO_PARENTS),
        replace(history, steps=steps | {-1: steps[0]}),
        replace(history, steps=steps | {2**62: steps[2]}),
    )
    for number, history in enumerate(harmed):
        with pytest.raises(ValueError, match="no tree"):
            history.check()
            raise AssertionError(number)


_OPERATIONS = st.one_of(
    st.tuples(st.sampled_from(["edit", "move", "drag", "turn", "note"]), st.integers(0, 5)),
    st.tuples(st.sampled_from(["undo", "redo", "release"]), st.just(0)),
    st.tuples(st.just("go"), st.integers(0, 100)),
)
_MODEL = random_model()


@settings(deadline=None, max_examples=200)
@given(st.lists(_OPERATIONS, max_size=30))
def test_the_laws_of_undo_hold_after_any_operations(operations: list[tuple[str, int]]) -> None:
    history = History.of(_state(_MODEL, 0, 0))
    for kind, number in operations:
        former = history
        history = _operated(history, kind, number)
        history.check()
        assert history.states[len(history.past)] is history.now
        if kind == "edit" and history is not former:
            assert history.undone().now is former.now
        if history.past:
            assert history.undone().redone().now is history.now
            assert history.undone().redone().states == history.states
        if history.future:
            assert history.redone().undone().now is history.now
        scenes = {id(state.scene) for state, _ in history.steps.values()}
        if not history.gesture:  # each state of a drag takes the place of the first before
            assert {id(state.scene) for state, _ in former.steps.values()} <= scenes
        if kind == "move":
            assert _edits(history) == _edits(former)
            assert history.future == former.future
        on_path = {number for group in history.edits() for edit in group for number in edit.steps}
        hidden = history.steps.keys() - on_path
        for branch in history.branches():
            branched = history.at(branch.last)
            hidden -= {number for group in branched.edits() for edit in group for number in edit.steps}
        assert all(_is_turned(history, number) for number in hidden)


@settings(deadline=None, max_examples=50)
@given(st.lists(_OPERATIONS, max_size=40))
def test_beyond_the_limit_only_the_oldest_ends_beside_the_path_are_dropped(operations: list[tuple[str, int]]) -> None:
    history = History.of(_state(_MODEL, 0, 0))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "DEPTH", 6)
        for kind, number in operations:
            former = history
            history = _operated(history, kind, number)
            history.check()
            assert len(history.steps) <= 7
            if former.states[0] is not history.states[0]:
                assert len(history.steps) == len(history.states)


@settings(deadline=None, max_examples=200)
@given(st.lists(_OPERATIONS, max_size=20), st.sets(st.integers(0, 12)))
def test_the_steps_that_are_left_are_one_tree(operations: list[tuple[str, int]], dropped: set[int]) -> None:
    history = History.of(_state(_MODEL, 0, 0))
    for kind, number in operations:
        history = _operated(history, kind, number)
    states = [step.state for number, step in history.steps.items() if number not in dropped]
    if not states:
        return
    left = history.without(dropped)
    left.check()
    assert [step.state for step in left.steps.values()] == states
    if history.current not in dropped:
        assert left.now is history.now
    path = [state for number, state in zip(history._path, history.states, strict=True) if number not in dropped]
    assert not path or list(left.states[: len(path)]) == path
    assert sorted(history.nearest) == list(history.steps) and history.nearest[0] == history.current


def _state(model: Model, number: int, azimuth: float) -> State:
    return State(Scene(model[number], model.camera(azimuth, 0)), Mix(Pair("a", "a"), "b"))


def _turned(state: State, model: Model, azimuth: float) -> State:
    return replace(state, scene=replace(state.scene, camera=model.camera(azimuth, 0)))


def _operated(history: History, kind: str, number: int) -> History:
    state = history.now
    changes = {
        "edit": lambda: history.changed(replace(state, scene=replace(state.scene, instance=_MODEL[number]))),
        "drag": lambda: history.changed(replace(state, scene=replace(state.scene, instance=_MODEL[number])), "drag"),
        "move": lambda: history.changed(_turned(state, _MODEL, 0.1 * number)),
        "turn": lambda: history.changed(_turned(state, _MODEL, 0.1 * number), "orbit", moves=True),
        "note": lambda: history.changed(replace(state, removed=frozenset({str(number)}))),
        "undo": history.undone,
        "redo": history.redone,
        "release": history.without_gesture,
        "go": lambda: history.at([*history.steps][number % len(history.steps)]),
    }
    return changes[kind]()


def _edits(history: History) -> list[str]:
    return [edit.words for group in history.edits() for edit in group] + [branch.words for branch in history.branches()]


def _is_turned(history: History, number: int) -> bool:
    """Whether a step differs from first before it by moves of the camera alone."""
    state, parent = history.steps[number]
    return parent >= 0 and state.is_move_of(history.steps[parent].state)
