"""Directions that are given a name, and the menu of one that has a name."""

from dataclasses import replace

from imgui_bundle import imgui

from viewer.context import PanelContext
from viewer.editor import Editor
from viewer.values.direction import Direction
from viewer.values.part import PARTS, Part
from viewer.widgets.controls import NameField, button, choose, tooltip
from viewer.widgets.text import caption, push_small

FILTER: dict[tuple[Part, ...], str] = {PARTS: "Shape and texture", ("shape",): "Shape", ("texture",): "Texture"}
_HINT = "Name, such as: sportier"


class NewDirection:
    """A popup that asks for the name, and, on the way from A to B, for what is to change."""

    def __init__(self) -> None:
        self._field = NameField()
        self._asks = False
        self._principal: Direction | None = None  # what is named; None: the way from A to B
        self._parts: tuple[Part, ...] = PARTS  # what changes on the way from A to B

    def ask(self, principal: Direction | None = None) -> None:
        """Ask for the name of a principal direction, or of the way from A to B."""
        self._asks, self._principal = True, principal

    def draw(self, context: PanelContext) -> None:
        """Once a frame."""
        if self._asks:
            imgui.open_popup("name a direction")
            self._asks = False
        if not imgui.begin_popup("name a direction"):
            return
        if self._principal:
            caption(context, f"Direction {self._principal.name} of the {in_words(self._principal.parts)}")
        else:
            caption(context, "The way from A to B")
            self._parts = choose("changes", self._parts, FILTER, "What it changes", 12)
        if name := self._field.draw(hint=_HINT):
            self._add(context, name)
        imgui.end_popup()

    def _add(self, context: PanelContext, name: str) -> None:
        editor = context.session.editor
        try:
            new = replace(self._principal or _from_a_to_b(editor, self._parts), name=name)
        except ValueError as error:
            context.session.messages.report("Cannot name the way from A to B", error)
        else:
            editor.set_directions((*editor.state.directions, new))


class DirectionMenu:
    """The name of a direction as a button, which opens its menu: rename, remove."""

    def __init__(self) -> None:
        self._field = NameField()

    def draw(self, context: PanelContext, index: int, label: str) -> None:
        """For the named direction of this number."""
        directions = context.session.editor.state.directions
        push_small()
        pressed = imgui.small_button(label)
        imgui.pop_font()
        tooltip("Rename it, or remove it")
        popup = f"direction {index}"
        if pressed:
            imgui.open_popup(popup)
        if not imgui.begin_popup(popup):
            return
        others = directions[:index], directions[index + 1 :]
        if new := self._field.draw(directions[index].name):
            context.session.editor.set_directions((*others[0], replace(directions[index], name=new), *others[1]))
        if button("Remove###remove direction", "Undo (Ctrl+Z) brings it back"):
            context.session.editor.set_directions((*others[0], *others[1]))
            imgui.close_current_popup()
        imgui.end_popup()


def in_words(parts: tuple[Part, ...]) -> str:
    """Shape, texture, or both."""
    return " and ".join(parts)


def _from_a_to_b(editor: Editor, parts: tuple[Part, ...]) -> Direction:
    mix = editor.state.mix
    ends = editor.pair(mix.a), editor.objects[mix.b].codes
    return Direction.between("A to B", editor.model.codes, ends, parts)
