"""The panel of sliders along the principal directions of shape and texture that have a word."""

from functools import lru_cache

import numpy as np
from imgui_bundle import ImVec2, hello_imgui, icons_fontawesome_4, imgui

from core.detail.progressive import Frame
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
from viewer.widgets.controls import action_button, begin_tooltip_at, end_gesture, flow, is_pointed_at
from viewer.widgets.size_row import draw_size
from viewer.widgets.text import caption, heading, paint_caption, small_height

_DICE = icons_fontawesome_4.ICON_FA_RANDOM
_RESET = icons_fontawesome_4.ICON_FA_UNDO
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
        draw_size(context)
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


def _preview(
    context: PanelContext, direction: Direction, instance: Instance, to: float, camera: Camera
) -> Frame | None:
    """Return the thumbnail of an object moved along a direction, or None until it is rendered."""
    return context.session.thumbnails.get(direction.moved(instance, to), camera, soon=True)
