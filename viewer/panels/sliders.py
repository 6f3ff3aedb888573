"""The panel of the object's size, and of sliders along the principal directions of its codes that have a word."""

from functools import lru_cache

import numpy as np
from imgui_bundle import ImVec2, hello_imgui, icons_fontawesome_4, imgui

from core.detail.progressive import Frame
from core.editing.bounds import portion_of
from core.editing.size import SIDES, lengths
from core.editing.words import OPPOSITES
from core.geometry.camera import Camera
from core.models.codes import CODE_KINDS, CodeKind
from core.models.model import Instance
from viewer.activities.thumbnails import SIZE
from viewer.context import Panel, PanelContext
from viewer.values import orbit
from viewer.values.direction import Direction
from viewer.values.influence import influence
from viewer.widgets import object_tiles
from viewer.widgets.controls import action_button, begin_tooltip_at, button, end_gesture, flow, is_pointed_at, tooltip
from viewer.widgets.text import caption, heading, paint_caption, small_height

_DICE = icons_fontawesome_4.ICON_FA_RANDOM
_RESET = icons_fontawesome_4.ICON_FA_UNDO
_HANDLES = icons_fontawesome_4.ICON_FA_ARROWS_ALT
_BOX = "Drag the sides of a box around the object, and its legs or roof"
_BUTTON = 2.0  # em, width of a button
_TITLES = {("cars", "depth"): "Length"}  # by category and length; others are named as in the core
_SPEED = 0.5  # % of a length per px of a drag
_FINE = 20.0  # cm below which a length has a decimal
_MOST = 2  # sliders of shape, and of texture: the directions along which objects differ most
_PREVIEWS = (0.0, 0.5, 1.0)  # places along a slider
_INFLUENCE = 96  # px, side of the compared renders
_influence = lru_cache(1)(influence)  # of the two ends of a slider


class SlidersPanel(Panel):
    """A slider per direction, from one word to its opposite, with previews under the mouse."""

    title = "Sliders"
    dock = "Right"

    def __init__(self) -> None:
        self._basis: Instance | None = None  # base of the thumbnails: the object before the drag began
        self.influence: np.ndarray | None = None  # the newest overlay, of a slider under the mouse

    def draw(self, context: PanelContext) -> None:
        """Draw the buttons, the size, then the sliders."""
        editor = context.session.editor
        if not editor.history.gesture:
            self._basis = editor.scene.instance
        action_button(context, "sample", f"{_DICE}  Random")
        flow(f"{_RESET}  Reset")
        action_button(context, "reset", f"{_RESET}  Reset")
        _draw_size(context)
        words = context.session.words.get(editor.model)
        if words is None:
            caption(context, "Measuring what the directions change …")
            return
        if imgui.begin_child("sliders", (0, 0), imgui.ChildFlags_.nav_flattened):
            for kind in CODE_KINDS:
                imgui.spacing()
                heading(context, kind.capitalize())
                named = [(index, more) for index, more in enumerate(words[kind]) if more]
                for index, more in named[:_MOST]:
                    self._draw_slider(context, kind, index, (OPPOSITES.get(more, ""), more))
        imgui.end_child()

    def _draw_slider(self, context: PanelContext, kind: CodeKind, index: int, ends: tuple[str, str]) -> None:
        """Draw a slider below the words of its ends."""
        editor = context.session.editor
        key = f"{kind} {index + 1}"
        direction = Direction.principal(editor.model.codes, kind, index)
        value = direction.strength(editor.scene.instance)
        corner = imgui.get_cursor_screen_pos()
        room = imgui.get_content_region_avail()
        paint_caption(context, ends[0], corner, room.x / 2, 0.0, quiet=False)
        paint_caption(context, ends[1], corner + ImVec2(room.x / 2, 0), room.x / 2, 1.0, quiet=False)
        imgui.dummy((room.x, small_height()))
        imgui.set_next_item_width(-1)
        low, high = direction.reach(editor.scene.instance)
        moved, to = imgui.slider_float(f"##{key}", value, low, high, "", imgui.SliderFlags_.always_clamp)
        if moved and abs(to - value) > 1e-6:
            context.session.reshaping.follow(key, direction.moved, to)
        end_gesture(context)
        if is_pointed_at():
            self._show_influence(context, direction)
            if is_pointed_at(imgui.HoveredFlags_.for_tooltip) and begin_tooltip_at(corner):
                self._draw_strip(context, direction)
                imgui.end_tooltip()

    def _show_influence(self, context: PanelContext, direction: Direction) -> None:
        """Overlay the object with the influence of the slider's ends."""
        editor = context.session.editor
        camera = editor.scene.camera.resized(_INFLUENCE, _INFLUENCE)
        instance = editor.scene.instance
        low, high = (_preview(context, direction, instance, to, camera) for to in direction.reach(instance))
        if low is not None and high is not None:
            self.influence = _influence(low, high)
            context.hints.overlay = self.influence

    def _draw_strip(self, context: PanelContext, direction: Direction) -> None:
        """Draw the object at a few positions of a slider."""
        side = object_tiles.THUMBNAIL * hello_imgui.em_size()
        model = context.session.editor.model
        corner = imgui.get_cursor_screen_pos()
        assert self._basis is not None
        low, high = direction.reach(self._basis)
        for number, fraction in enumerate(_PREVIEWS):
            camera = orbit.home(model).resized(SIZE, SIZE)
            frame = _preview(context, direction, self._basis, low + fraction * (high - low), camera)
            object_tiles.paint_frame(context, frame, corner + ImVec2(1.1 * number * side, 0), side)
        imgui.dummy((1.1 * len(_PREVIEWS) * side, side))


def _draw_size(context: PanelContext) -> None:
    """Draw the fields of the size, a button for the box with handles, and one for the natural size."""
    editor = context.session.editor
    bounds = context.session.reshaping.bounds
    instance = editor.scene.instance
    measured = lengths(instance, bounds) if bounds else {}
    portion = portion_of(instance.model)
    imgui.begin_disabled(bounds is None)
    imgui.align_text_to_frame_padding()
    heading(context, "Size")
    imgui.same_line()
    is_tool = context.tool == "size"
    if button(f"{_HANDLES}###size handles", _BOX, _BUTTON, colour=context.palette.accent if is_tool else None):
        context.tool = "turn" if is_tool else "size"
    imgui.same_line()
    if button(f"{_RESET}###natural size", "The natural size", _BUTTON, enabled=instance.is_sized):
        editor.edit(instance.natural)
    gap = imgui.get_style().item_inner_spacing.x
    width = (imgui.get_content_region_avail().x - gap) / 2
    names = (*SIDES, portion.name) if portion and (bounds is None or portion.name in measured) else SIDES
    for number, name in enumerate(names):
        if number % 2:
            imgui.same_line(0, gap)
        imgui.set_next_item_width(width)
        _draw_length(context, name, measured.get(name, 0.0))
    imgui.end_disabled()


def _draw_length(context: PanelContext, name: str, length: float) -> None:
    """Draw a field for a length in cm; 0 is not known, and cannot be changed."""
    category = context.session.editor.model.category
    title = _TITLES.get((category, name), name.capitalize())
    decimals = 1 if length < _FINE else 0
    text = f"{title} %.{decimals}f cm" if length else title
    moved, to = imgui.drag_float(f"##{title}", length, max(0.01, _SPEED * length / 100), 0.0, 0.0, text)
    if moved and length and to > 0 and abs(to - length) > 1e-6:
        context.session.reshaping.resize(name, to)
    end_gesture(context)
    if imgui.is_item_hovered() or imgui.is_item_active():
        context.hints.shows_size = True
    tooltip(f"{title} in cm: drag, or click to type")


def _preview(
    context: PanelContext, direction: Direction, instance: Instance, to: float, camera: Camera
) -> Frame | None:
    """Return the thumbnail of an object moved along a direction, or None until it is rendered."""
    return context.session.thumbnails.get(direction.moved(instance, to), camera, soon=True)
