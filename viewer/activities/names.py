"""Names of objects and of their versions, by what their images and codes show. A person's own name stays."""

import re
from functools import lru_cache

from core.detail.progressive import Frame
from core.editing.words import OPPOSITES
from core.models.model import Instance
from viewer.activities.direction_words import DirectionWords
from viewer.activities.thumbnails import Thumbnails
from viewer.editor import Editor
from viewer.values.direction import Direction
from viewer.values.history import Pair
from viewer.values.naming import colour_word, height_word, new_colour_word
from viewer.values.variety import readable

_NUMBERED = re.compile(r" \(\d+\)$")  # end of a version's name that no person chose
_LEAST = 0.05  # standard deviations along a direction: a smaller difference gets no word
_MEASURED = 1000  # thumbnails whose words are kept


class Names:
    """Tells objects apart by colour and height, and versions of an object by what differs from the fit."""

    def __init__(self, editor: Editor, thumbnails: Thumbnails, words: DirectionWords) -> None:
        self._editor = editor
        self._thumbnails = thumbnails
        self._words = words

    def label(self, name: str) -> str:
        """Return an object's name for people, such as *Low red car* or *police, red*."""
        objects = self._editor.objects
        words, comma, variant = readable(name).partition(", ")
        if name in objects and objects.root(name) != name:
            words = self.version(name, objects[name].instance)
            return words if words == name else f"{objects.root(name)}, {words}"
        look = self._look_of_nameless(name) if name in objects else ""
        return (f"{look} {words.lower()}" if look else words) + comma + variant

    def caption(self, name: str) -> str:
        """Return the words below an object's tile: of a model's object without its kind, which stands above."""
        is_form = name in self._editor.objects.families_of(name)
        words, comma, variant = readable(name).partition(", ")
        return self._look_of_nameless(name) or words + ("" if is_form else comma + variant)

    def _look_of_nameless(self, name: str) -> str:
        """Return height and colour of a model's object that is named by its category only, else ""."""
        objects = self._editor.objects
        instance = objects[name].instance
        if objects.is_added(name) or instance.is_missing:
            return ""
        is_named = readable(name).partition(", ")[0].lower() != instance.model.noun
        return "" if is_named else " ".join(self._look(instance)).capitalize()

    def pair(self, pair: Pair) -> str:
        """Return a name for the shape of an object in the texture of another."""
        return pair.words(self.label)

    def version(self, name: str, instance: Instance) -> str:
        """Return the words for codes of an object's version: its own name, or what differs from the fit."""
        objects = self._editor.objects
        chosen = (version for version in objects.named(name, instance) if objects[version].version_of)
        if own := next((version for version in chosen if not _NUMBERED.search(version)), ""):
            return own
        root = objects[objects.root(name)]
        if instance == root.original:
            return "as fitted" if root.fitted else "as opened"
        if instance.is_missing or root.original.is_missing:
            return "edited"
        shape = _direction_word(instance, root.original, self._words.of_shape(instance.model))
        is_resized = instance.codes.edits_of("size") != root.original.codes.edits_of("size")
        size = "resized" if is_resized else ""
        return ", ".join(filter(None, (self._paint_word(instance, root.original), shape or size))) or "edited"

    def _paint_word(self, instance: Instance, original: Instance) -> str:
        """Return the colour that a changed texture brings; "repainted" for a shade of one that was there."""
        if instance.codes.texture_key == original.codes.texture_key:
            return ""
        before = self._thumbnails.of_object(original)
        after = self._thumbnails.of_object(instance)
        return _new_colour(before, after) if before and after else ""

    def _look(self, instance: Instance) -> tuple[str, ...]:
        """Return the words for height, if any, and colour of an object; none until its thumbnail is rendered."""
        frame = self._thumbnails.of_object(instance)
        return _words_of(frame, instance.model.category) if frame else ()


@lru_cache(_MEASURED)
def _words_of(frame: Frame, category: str) -> tuple[str, ...]:
    words = height_word(frame.opacity, category), colour_word(frame.image, frame.opacity)
    return tuple(filter(None, words))


@lru_cache(_MEASURED)
def _new_colour(before: Frame, after: Frame) -> str:
    return new_colour_word((before.image, before.opacity), (after.image, after.opacity)) or "repainted"


@lru_cache(_MEASURED)
def _direction_word(instance: Instance, original: Instance, words: tuple[str, ...]) -> str:
    """Return the word of the direction of the shape along which an object differs most; "" if along none."""
    book = instance.model.codes
    directions = [Direction.principal(book, "shape", index) for index, word in enumerate(words) if word]
    moves = {direction: direction.strength(instance) - direction.strength(original) for direction in directions}
    longest = max(directions, key=lambda direction: abs(moves[direction]), default=None)
    if longest is None or abs(moves[longest]) < _LEAST:
        return ""
    word = words[longest.index]
    return word if moves[longest] > 0 else OPPOSITES.get(word, "")
