"""The undo history: a tree of states, of which undo and redo follow one path. A drag is one step."""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import groupby, pairwise
from typing import NamedTuple

from core.models.model import Instance
from viewer.values.state import Label, Pair, State
from viewer.values.variety import readable

_LARGEST = 2**60  # limit of a step's number, so that later ones are integers of a database
DEPTH = 500  # states kept beside the current one; one holds a few hundred numbers, or 0.2 MB if it mixes a network


class Step(NamedTuple):
    """A state in the tree of a history."""

    state: State
    parent: int  # number of the step before it; -1 for the first


class Edit(NamedTuple):
    """An edit of the codes, with the changes of camera, B or removed objects that follow it."""

    steps: tuple[int, ...]  # numbers of its steps, in order
    words: str  # description
    pair: Pair  # object A

    @property
    def last(self) -> int:
        """Number of the last step."""
        return self.steps[-1]


class Branch(NamedTuple):
    """Steps that are not on the current path, from a step of the path to an end."""

    start: int  # number of the path's step
    last: int  # number of the end
    words: str  # description of its last edit


@dataclass(frozen=True)
class History:
    """A tree of states. Undo goes to the step before, redo towards ``tip``. Every change makes a new history.

    An edit of the codes from an earlier state begins a branch: later states stay. Other changes (camera, B,
    removed objects) are inserted after the current step, and redo goes on from there; later states take over removed
    objects.
    """

    steps: Mapping[int, Step]  # by number, in the order in which they were made
    current: int = 0  # number of the current step
    tip: int = 0  # number of the end of the current path
    gesture: str = ""  # name of the current drag, whose edits replace the current state; empty: none
    moved: bool = field(default=False, compare=False)  # the last step moved the camera; the next move joins it

    @classmethod
    def of(cls, *states: State) -> History:
        """Return the history of consecutive states; the last one is the current state."""
        steps = {number: Step(state, number - 1) for number, state in enumerate(states)}
        return cls(steps, len(steps) - 1, len(steps) - 1)

    def check(self) -> None:
        """Raise ``ValueError`` unless the steps are one tree and the current step is on the path to the tip."""
        is_numbered = all(0 <= number < _LARGEST for number in self.steps)
        is_tree = is_numbered and len(self._children.get(-1, ())) == 1 and len(self._descending) == len(self.steps)
        if not is_tree or self.tip not in self._ends or self.current not in self._path:
            raise ValueError("the undo history is no tree")

    # The current path

    @property
    def now(self) -> State:
        """The current state."""
        return self.steps[self.current].state

    @cached_property
    def _path(self) -> tuple[int, ...]:
        """Numbers of the steps from the first to the tip."""
        path = [self.tip]
        while (parent := self.steps[path[-1]].parent) >= 0:
            path.append(parent)
        return tuple(reversed(path))

    @cached_property
    def _place(self) -> int:
        """Position of the current step in the path."""
        return self._path.index(self.current)

    @cached_property
    def states(self) -> tuple[State, ...]:
        """The states of the current path, the oldest first; the current one has the position ``len(past)``."""
        return tuple(self.steps[number].state for number in self._path)

    @property
    def past(self) -> tuple[State, ...]:
        """The states that undo goes back to, the oldest first."""
        return self.states[: self._place]

    @property
    def future(self) -> tuple[State, ...]:
        """The states that redo goes on to, the next first."""
        return tuple(self.steps[number].state for number in self._later)

    @cached_property
    def newest(self) -> tuple[str, ...]:
        """Names of the objects of which the states up to the current one are versions, the newest first."""
        return tuple(dict.fromkeys(state.version_of for state in (self.now, *reversed(self.past))))

    def left_by(self, newer: History) -> dict[str, Instance]:
        """Return the last versions of objects, by name, on the part of this path that another history has left."""
        if newer.tip == self.tip:
            return {}
        ids = {id(state) for state in newer.states}
        left = [state for state in self.states if id(state) not in ids and state.version_of]
        return {state.version_of: state.scene.instance for state in left}

    def edits(self, label: Label = readable) -> tuple[tuple[Edit, ...], ...]:
        """Return the edits of the current path, the oldest first, grouped by object A."""
        states = self.states
        begins = [0, *(index for index in range(1, len(states)) if states[index].is_edit_of(states[index - 1]))]
        ends = [*begins[1:], len(states)]
        words = (states[index].change_from(states[index - 1], label) if index else "at first" for index in begins)
        spans = zip(begins, ends, words, strict=True)
        edits = [Edit(self._path[begin:end], text, states[end - 1].mix.a) for begin, end, text in spans]
        return tuple(tuple(group) for _, group in groupby(edits, lambda edit: edit.pair))

    # Branches

    @cached_property
    def _children(self) -> dict[int, list[int]]:
        """Numbers of the steps after each step, in the order in which they were made."""
        children = dict[int, list[int]]()
        for number, step in self.steps.items():
            children.setdefault(step.parent, []).append(number)
        return children

    @cached_property
    def _descending(self) -> tuple[int, ...]:
        """Numbers of the steps that can be reached from the first, each after its parent."""
        reached = list(self._children.get(-1, ()))
        for number in reached:
            reached += self._children.get(number, ())
        return tuple(reached)

    @property
    def _ends(self) -> tuple[int, ...]:
        """Numbers of the steps that none follows, the oldest first."""
        return tuple(number for number in self.steps if number not in self._children)

    def branches(self, label: Label = readable) -> tuple[Branch, ...]:
        """Return a branch for each end that is not the tip, the oldest first, except mere moves of the camera."""
        return tuple(branch for end in self._ends if end != self.tip and (branch := self._branch(end, label)))

    def _branch(self, end: int, label: Label) -> Branch | None:
        """Return the branch to an end; None if only the camera differs from the path."""
        path = set(self._path)
        chain = [end]
        while self.steps[chain[-1]].parent not in path:
            chain.append(self.steps[chain[-1]].parent)
        start = self.steps[chain[-1]].parent
        if all(self.steps[number].state.is_move_of(self.steps[start].state) for number in chain):
            return None
        edit = next((number for number in chain if self._is_edit(number)), end)
        words = self.steps[edit].state.change_from(self.steps[self.steps[edit].parent].state, label)
        return Branch(start, end, words)

    def _is_edit(self, number: int) -> bool:
        state, parent = self.steps[number]
        return parent >= 0 and state.is_edit_of(self.steps[parent].state)

    def _end(self, number: int) -> int:
        """Return the number of the newest end of the branches after a step."""
        while children := self._children.get(number):
            number = children[-1]
        return number

    # Changes

    def changed(self, state: State, gesture: str = "", moves: bool = False) -> History:
        """Return the history with a changed state as the current one.

        Changes of one gesture are one step, and so are consecutive camera moves (``moves``).
        """
        if state == self.now:
            return self
        joins = (bool(gesture) and gesture == self.gesture) or (moves and self.moved)
        history = self._continued(state) if joins else self._added(state)
        return replace(history, gesture=gesture, moved=moves)

    def joined(self, state: State) -> History:
        """Return the history with another state in place of the current one."""
        return self._with({self.current: self.steps[self.current]._replace(state=state)})

    def _with(self, steps: Mapping[int, Step]) -> History:
        """Return the history with changed or new steps."""
        return replace(self, steps={**self.steps, **steps})

    def _added(self, state: State) -> History:
        """Return the history with a new step: an edit begins a branch, another change is inserted in the path."""
        number = max(self.steps) + 1
        history = self._with({number: Step(state, self.current)})
        if self._later and not state.is_edit_of(self.now):
            history = history._with(self._later_after(number, state))
        else:
            history = replace(history, tip=number)
        return replace(history, current=number)._shortened()

    def _continued(self, state: State) -> History:
        """Return the history with the drag's newest state; once it is an edit, later states are another branch."""
        history = self.joined(state)
        parent = self.steps[self.current].parent
        if history._is_edit(self.current):
            return replace(history._with(self._later_after(parent, self.steps[parent].state)), tip=self.current)
        return history._with(self._later_after(self.current, state))

    @property
    def _later(self) -> tuple[int, ...]:
        """Numbers of the steps that redo goes on to."""
        return self._path[self._place + 1 :]

    def _later_after(self, number: int, state: State) -> dict[int, Step]:
        """Return the steps that redo goes on to, after a step whose state changes removed objects."""
        later = dict[int, Step]()
        for parent, following in pairwise((number, *self._later)):
            later[following] = Step(self.steps[following].state.carrying(self.now, state), parent)
        return later

    def _shortened(self) -> History:
        """Return the history without its oldest ends beyond the limit, first those that are not on the path."""
        history = self
        while len(history.steps) > DEPTH + 1:
            history = history.without({next((end for end in history._ends if end != history.tip), history._path[0])})
        return history

    def without(self, dropped: Container[int]) -> History:
        """Return the history without some steps; later steps follow those before. At least one step must be left.

        Without the first step, the next one on the current path is the first, and other branches begin there.
        """
        remaining = [number for number in self.steps if number not in dropped]
        root = next((number for number in self._path if number not in dropped), remaining[0])
        last = {-1: root}  # by step: itself, or else the last one before it that is remaining
        for number in self._descending:
            last[number] = last[self.steps[number].parent] if number in dropped else number
        parents = {number: last[self.steps[number].parent] for number in remaining} | {root: -1}
        steps = {number: Step(self.steps[number].state, parent) for number, parent in parents.items()}
        history = replace(self, steps=steps, current=last[self.current], tip=last[self.tip])
        return replace(history, tip=history._end(history.tip))

    def without_gesture(self) -> History:
        """Return the history with the drag ended: the next edit is another step."""
        return replace(self, gesture="")

    def cancelled(self) -> History:
        """Return the history without the step of the drag in progress; a camera, whose moves are one step, stays."""
        has_step = self.gesture and not self.moved and self.current != self._path[0]
        return (self.without({self.current}) if has_step else self).without_gesture()

    # Other states

    def undone(self) -> History:
        """Return the history one step back, if there is one."""
        return self.at(self._path[max(0, self._place - 1)])

    def redone(self) -> History:
        """Return the history one step forward, if there is one."""
        return self.at(self._path[self._place :][:2][-1])

    def at(self, number: int) -> History:
        """Return the history with another step as the current one, by its number.

        The path stays if it has the step; otherwise it leads through the step to the newest end after it.
        """
        if number == self.current:
            return self
        tip = self.tip if number in self._path else self._end(number)
        return replace(self, current=number, tip=tip, gesture="", moved=False)

    @property
    def nearest(self) -> tuple[int, ...]:
        """Numbers of all steps: the current one, those before it, those after it, then those of other branches."""
        aside = self.steps.keys() - set(self._path)
        return (*reversed(self._path[: self._place + 1]), *self._later, *sorted(aside, reverse=True))

    def after(self, earlier: History) -> History:
        """Return the history with all states of another one before its own."""
        shift = max(earlier.steps) + 1
        later = {
            number + shift: Step(state, earlier.tip if parent < 0 else parent + shift)
            for number, (state, parent) in self.steps.items()
        }
        steps = {**earlier.steps, **later}
        return replace(self, steps=steps, current=self.current + shift, tip=self.tip + shift)._shortened()

    def renamed(self, names: Mapping[str, str]) -> History:
        """Return the history with objects renamed in every state, from keys to values of ``names``."""
        return self.everywhere(lambda state: state.renamed(names))

    def everywhere(self, change: Callable[[State], State]) -> History:
        """Return the history with ``change`` applied to every state."""
        return self._with({number: Step(change(state), parent) for number, (state, parent) in self.steps.items()})
