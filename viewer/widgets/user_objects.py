"""Added objects: the dots on their tiles, and their menu entries."""

from collections.abc import Collection
from datetime import datetime

from imgui_bundle import ImVec2, hello_imgui, imgui

from core.fitting.confidence import in_words
from core.models.model import Instance
from viewer.context import PanelContext
from viewer.screen.theme import WARM, Colour, packed
from viewer.values.objects import EditableObject
from viewer.values.variety import readable
from viewer.widgets.controls import NameField, tooltip

COLOURS: dict[str, Colour] = {"sure": (0.35, 0.75, 0.5), "likely": (0.85, 0.8, 0.35), "doubtful": WARM}
"""Colours of confidences, by :func:`core.fitting.confidence.in_words`."""
_UNKNOWN: Colour = (0.6, 0.63, 0.66)


def draw_dot(context: PanelContext, name: str, corner: ImVec2, side: float) -> None:
    """Draw a fitted object's dot in the colour of its confidence, and a dot on an object not shown yet."""
    added = context.session.editor.objects[name]
    em = hello_imgui.em_size()
    draw = imgui.get_window_draw_list()
    if name in context.session.fitting.results.unseen:
        centre = corner + ImVec2(side - 0.75 * em, 0.75 * em)
        draw.add_circle_filled(centre, 0.42 * em, packed(context.palette.accent))
    if added.fitted:
        centre = corner + ImVec2(side, side) - ImVec2(0.75, 0.75) * em
        draw.add_circle_filled(centre, 0.42 * em, packed((0.07, 0.08, 0.09)))
        draw.add_circle_filled(centre, 0.3 * em, packed(colour_of(added)))


def colour_of(added: EditableObject) -> Colour:
    """Return the colour of an object's confidence: green sure, yellow likely, orange doubtful, grey unknown."""
    return _UNKNOWN if added.confidence is None else COLOURS[in_words(added.confidence)]


def about(added: EditableObject) -> str:
    """Return a line for the tooltip of a fitted object, which tells fits of one photo apart; "" for any other."""
    if not added.fitted:
        return ""
    sure = "" if added.confidence is None else f", the camera right with a probability of {added.confidence:.0%}"
    detail = added.instance.detail
    photos = "photos" if detail and len(detail.views) > 1 else "a photo"
    made = datetime.fromtimestamp(int(added.key or 0) / 1e9)
    return f"\nFitted to {photos} on {made:%d %B at %H:%M}{sure}"


class UserObjectMenu:
    """The menu entries of an added object or one of its versions: keep, rename, remove."""

    def __init__(self) -> None:
        self._field = NameField()
        self._renamed: tuple[str, str] | None = None  # an object's name and its new name

    def draw(
        self, context: PanelContext, name: str, instance: Instance, renamed: str, removed: Collection[str]
    ) -> None:
        """Draw the entries in an added object's menu.

        Args:
            name: the object or one of its versions.
            instance: codes to keep as a version.
            renamed: the object or version to rename; "" for none.
            removed: the versions to remove; none: nothing can be removed.
        """
        objects = context.session.editor.objects
        imgui.separator()
        is_kept = instance == objects[objects.root(name)].original or len(objects.named(name, instance)) > 1
        if imgui.menu_item_simple("Keep this version###keep version", enabled=not is_kept):
            objects.keep(name, instance)
        tooltip("Later edits leave a version like this one")
        if renamed:
            self._draw_rename(renamed)
        if imgui.menu_item_simple("Remove###remove object", enabled=bool(removed)):
            context.session.remove(*removed)

    def apply(self, context: PanelContext) -> None:
        """Rename the object; call after all tiles are drawn, as they use the old name."""
        if self._renamed:
            context.session.rename(*self._renamed)
            self._renamed = None

    def _draw_rename(self, name: str) -> None:
        if imgui.begin_menu("Rename###rename object"):
            if new := self._field.draw(readable(name)):
                self._renamed = name, new
            imgui.end_menu()
