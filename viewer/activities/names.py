"""Names of objects and of their versions, by what their codes and edits say. A person's own name stays."""

import re
from collections.abc import Callable
from functools import lru_cache

from core.editing.words import OPPOSITES, Words
from core.edits.paint import PartPaint
from core.export.variants import is_variant
from core.models.latents import CodeKind
from core.models.model import Instance, Model
from viewer.editor import Editor
from viewer.values.direction import Direction
from viewer.values.naming import colour_word
from viewer.values.objects import unique_name
from viewer.values.state import Pair
from viewer.values.variety import readable

_NUMBERED = re.compile(r" \(\d+\)$")  # end of a version's name that no person chose
_LEAST = 0.05  # standard deviations along a direction: a smaller difference gets no word
_MOST_COLOURS = 8  # versions in one file
_MEASURED = 1000  # pairs of objects whose words are kept


class Names:
    """Tells versions of an object apart by what differs from the fit."""

    def __init__(self, editor: Editor, words: Callable[[Model], Words | None]) -> None:
        self._editor = editor
        self._words = words

    def label(self, name: str) -> str:
        """Return an object's name for people, such as *Chair 103* or *police, red*."""
        objects = self._editor.objects
        if name in objects and objects.root(name) != name:
            words = self.version(name, objects[name].instance)
            return words if words == name else f"{objects.root(name)}, {words}"
        return readable(name)

    def caption(self, name: str) -> str:
        """Return the words below an object's tile: those of a form without its first variant."""
        is_form = name in self._editor.objects.families_of(name)
        words, comma, variant = readable(name).partition(", ")
        return words + ("" if is_form else comma + variant)

    def pair(self, pair: Pair) -> str:
        """Return a name for the shape of an object in the texture of another."""
        return pair.words(self.label)

    def version(self, name: str, instance: Instance) -> str:
        """Return the words for codes of an object's version: its own name, or what differs from the fit."""
        objects = self._editor.objects
        versions = (version for version in objects.named(name, instance) if objects[version].version_of)
        if named := next((version for version in versions if not _NUMBERED.search(version)), ""):
            return named
        root = objects[objects.root(name)]
        if instance == root.original:
            return "as fitted" if root.fitted else "as opened"
        if instance.is_missing or root.original.is_missing:
            return "edited"
        shape = self._direction_word("shape", instance, root.original)
        is_resized = instance.codes.edits_of("size") != root.original.codes.edits_of("size")
        size = "resized" if is_resized else ""
        return ", ".join(filter(None, (self._paint_word(instance, root.original), shape or size))) or "edited"

    def colours(self) -> list[Instance]:
        """Return the object on screen, then its versions and earlier states of the same shape, the newest first."""
        editor = self._editor
        colours = [editor.scene.instance]
        name = editor.state.version_of
        if not name:
            return colours
        states = [state.scene.instance for state in reversed(editor.history.states) if state.version_of == name]
        for instance in (*states, *reversed(editor.objects.states(name))):
            if not instance.is_missing and is_variant(colours[0], instance) and instance not in colours:
                colours.append(instance)
        return colours[:_MOST_COLOURS]

    def colour_versions(self) -> dict[str, Instance]:
        """Return the object on screen and its other versions of the same shape, by name, the newest first."""
        variants: dict[str, Instance] = {}
        root = self._editor.state.version_of
        for instance in self.colours():
            name = self.version(root, instance) if root else "as shown"
            variants[unique_name(name, variants)] = instance
        return variants

    def _paint_word(self, instance: Instance, original: Instance) -> str:
        """Return the colour of the last new paint, else the word of a changed texture, else "repainted"."""
        if instance.codes.texture_key == original.codes.texture_key:
            return ""
        paints = [paint for paint in instance.codes.of_kind(PartPaint) if paint not in original.codes.edits]
        if paints:
            return colour_word(paints[-1].colour)
        return self._direction_word("texture", instance, original) or "repainted"

    def _direction_word(self, kind: CodeKind, instance: Instance, original: Instance) -> str:
        words = (self._words(instance.model) or {}).get(kind, ())
        return _direction_word(instance, original, kind, words)


@lru_cache(_MEASURED)
def _direction_word(instance: Instance, original: Instance, kind: CodeKind, words: tuple[str, ...]) -> str:
    """Return the word of the direction along which an object differs most; "" if along none."""
    book = instance.model.codes
    directions = [Direction.principal(book, kind, index) for index, word in enumerate(words) if word]
    moves = {direction: direction.strength(instance) - direction.strength(original) for direction in directions}
    longest = max(directions, key=lambda direction: abs(moves[direction]), default=None)
    if longest is None or abs(moves[longest]) < _LEAST:
        return ""
    word = words[longest.index]
    return word if moves[longest] > 0 else OPPOSITES.get(word, "")
