"""The undo history: the current state between earlier and later ones. A drag is one step."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import groupby
from typing import NamedTuple

import torch

from core.export.keyframes import Timeline
from core.models.codes import CODE_KINDS
from core.models.scene import Scene
from viewer.values.variety import readable

_DEPTH = 500  # earlier states kept; a state holds a few hundred numbers


class Pair(NamedTuple):
    """The names of the objects whose shape and texture make one object."""

    shape: str
    texture: str

    @property
    def words(self) -> str:
        """The composed object's readable name."""
        shape, texture = map(readable, self)
        return shape if self.shape == self.texture else f"{shape} as {texture}"


@dataclass(frozen=True)
class Mix:
    """The mixed objects A and B, and the amount of B in shape and texture."""

    a: Pair
    b: str  # name
    shape: float = 0.0  # 0 (A) to 1 (B)
    texture: float = 0.0  # 0 (A) to 1 (B)

    def with_amount(self, kind: str, amount: float) -> Mix:
        """Return the mix with another amount of B in one code."""
        return Mix(self.a, self.b, **({"shape": self.shape, "texture": self.texture} | {kind: amount}))

    @property
    def names(self) -> frozenset[str]:
        """Names of the mixed objects."""
        return frozenset((*self.a, self.b))

    def renamed(self, names: Mapping[str, str]) -> Mix:
        """Return the mix with objects renamed from keys to values of ``names``."""
        return replace(self, a=Pair(*(names.get(name, name) for name in self.a)), b=names.get(self.b, self.b))


@dataclass(frozen=True)
class State:
    """A state of the editor: everything that undo restores."""

    scene: Scene
    mix: Mix
    timeline: Timeline = field(default_factory=Timeline)

    def change_from(self, before: State) -> str:
        """Describe the edit since an earlier state in a few words."""
        mix, was = self.mix, before.mix
        if mix.a != was.a:
            return mix.a.words
        if (mix.shape, mix.texture) != (was.shape, was.texture):
            return f"{readable(mix.b)} mixed in: shape {mix.shape:.0%}, texture {mix.texture:.0%}"
        now, then = self.scene.codes, before.scene.codes
        kinds = (kind for kind in CODE_KINDS if not torch.equal(getattr(now, kind), getattr(then, kind)))
        return " and ".join(kinds) or "photo detail"


class Edit(NamedTuple):
    """An edit of the codes, with the changes of camera, B or timeline that follow it."""

    last: int  # index of its last state
    words: str  # description
    of: Pair  # object A


@dataclass(frozen=True)
class History:
    """The current state between two tuples of states. Every edit makes a new history."""

    now: State
    past: tuple[State, ...] = ()
    future: tuple[State, ...] = ()
    gesture: str = ""  # name of the current drag, whose edits replace the current state; empty: none
    moved: bool = field(default=False, compare=False)  # the last step moved the camera; the next move joins it

    def changed(self, state: State, gesture: str = "", moves: bool = False) -> History:
        """Return the history with an edited state as the current one; later states are dropped.

        Edits of one gesture are one step, and so are consecutive camera moves (``moves``).
        """
        if state == self.now:
            return self
        same = (bool(gesture) and gesture == self.gesture) or (moves and self.moved)
        past = self.past if same else (*self.past, self.now)[-_DEPTH:]
        return History(state, past, (), gesture, moves)

    def without_gesture(self) -> History:
        """Return the history with the drag ended: the next edit is another step."""
        return replace(self, gesture="")

    def undone(self) -> History:
        """Return the history one step back, if there is one."""
        if not self.past:
            return self
        return History(self.past[-1], self.past[:-1], (self.now, *self.future))

    def redone(self) -> History:
        """Return the history one step forward, if there is one."""
        if not self.future:
            return self
        return History(self.future[0], (*self.past, self.now), self.future[1:])

    @property
    def states(self) -> tuple[State, ...]:
        """All states, the oldest first; the current one has the index ``len(past)``."""
        return (*self.past, self.now, *self.future)

    @property
    def edits(self) -> tuple[tuple[Edit, ...], ...]:
        """All edits, the oldest first, grouped by object A."""
        states = self.states
        changed = (at for at in range(1, len(states)) if states[at].scene.codes != states[at - 1].scene.codes)
        begins = [0, *changed]
        ends = (*(begin - 1 for begin in begins[1:]), len(states) - 1)
        words = (states[at].change_from(states[at - 1]) if at else "at first" for at in begins)
        found = [Edit(end, what, states[end].mix.a) for end, what in zip(ends, words, strict=True)]
        return tuple(tuple(group) for _, group in groupby(found, lambda edit: edit.of))

    def at(self, index: int) -> History:
        """Return the history with another state as the current one, by its index in :attr:`states`."""
        states = self.states
        return History(states[index], states[:index], states[index + 1 :])

    def after(self, earlier: History) -> History:
        """Return the history with all states of another one before its own."""
        return replace(self, past=(*earlier.states, *self.past)[-_DEPTH:])

    def renamed(self, names: Mapping[str, str]) -> History:
        """Return the history with objects renamed in every state, from keys to values of ``names``."""
        return self.everywhere(lambda state: replace(state, mix=state.mix.renamed(names)))

    def everywhere(self, change: Callable[[State], State]) -> History:
        """Return the history with ``change`` applied to every state."""
        return History(change(self.now), tuple(map(change, self.past)), tuple(map(change, self.future)), self.gesture)
