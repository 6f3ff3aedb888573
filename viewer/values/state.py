"""A state of the editor: the scene, the objects that it was made from, and those that were removed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

from core.models.codes import CODE_KINDS
from core.models.scene import Scene
from viewer.values.variety import readable

Label = Callable[[str], str]  # the words for an object's name


class Pair(NamedTuple):
    """The names of the objects whose shape and texture make one object."""

    shape: str
    texture: str

    def words(self, label: Label = readable) -> str:
        """Return the composed object's readable name."""
        shape, texture = map(label, self)
        return shape if self.shape == self.texture else f"{shape} as {texture}"


@dataclass(frozen=True)
class Mix:
    """The mixed objects A and B, and the amount of B in shape and texture."""

    a: Pair
    b: str  # name
    shape: float = 0.0  # 0 (A) to 1 (B)
    texture: float = 0.0  # 0 (A) to 1 (B)

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
    removed: frozenset[str] = frozenset()  # names of unlisted added objects
    is_a: bool = False  # the codes are those of object A, perhaps edited: not sampled

    @property
    def version_of(self) -> str:
        """Name of the object of which the codes are a version; "" for mixes and samples."""
        return "" if self.mix.shape or self.mix.texture else self._a

    @property
    def mixed_from(self) -> str:
        """Name of the object A that has some of B in it; "" for other codes."""
        return self._a if self.mix.shape or self.mix.texture else ""

    @property
    def _a(self) -> str:
        """Name of object A; "" if its shape and texture have two names, and for samples."""
        shape, texture = self.mix.a
        return shape if self.is_a and shape == texture else ""

    def renamed(self, names: Mapping[str, str]) -> State:
        """Return the state with objects renamed from keys to values of ``names``."""
        removed = frozenset(names.get(name, name) for name in self.removed)
        return replace(self, mix=self.mix.renamed(names), removed=removed)

    def change_from(self, earlier: State, label: Label = readable) -> str:
        """Describe the edit since an earlier state in a few words."""
        mix = self.mix
        if mix.a != earlier.mix.a:
            return mix.a.words(label)
        if (mix.shape, mix.texture) != (earlier.mix.shape, earlier.mix.texture):
            return f"{label(mix.b)} mixed in: shape {mix.shape:.0%}, texture {mix.texture:.0%}"
        codes = self.scene.instance.natural.codes
        then = earlier.scene.instance.natural.codes
        kinds = (kind for kind in CODE_KINDS if getattr(codes, f"{kind}_key") != getattr(then, f"{kind}_key"))
        return " and ".join(kinds) or self._aside_from(earlier, label)

    def _aside_from(self, earlier: State, label: Label) -> str:
        """Describe a change that keeps both codes."""
        if self.is_edit_of(earlier):
            edits, earlier_edits = (state.scene.instance.codes.edits_of("size") for state in (self, earlier))
            return "photo detail" if edits == earlier_edits else "size"
        return "removed objects" if self.removed != earlier.removed else f"{label(self.mix.b)} as B"

    def is_edit_of(self, earlier: State) -> bool:
        """Return whether the codes differ from an earlier state's."""
        return self.scene.instance is not earlier.scene.instance and self.scene.instance != earlier.scene.instance

    def carrying(self, earlier: State, later: State) -> State:
        """Return the state after a change of removed objects from ``earlier`` to ``later``; itself without one."""
        if later.removed == earlier.removed:
            return self
        removed = (self.removed | (later.removed - earlier.removed)) - (earlier.removed - later.removed)
        return replace(self, removed=removed)

    def is_move_of(self, earlier: State) -> bool:
        """Return whether only the camera differs from an earlier state, if anything does."""
        return replace(self, scene=replace(self.scene, camera=earlier.scene.camera)) == earlier
