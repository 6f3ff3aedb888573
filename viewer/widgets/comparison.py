"""The photo over the view, seen from the photo's camera; a drag moves the line between photo and render."""

from functools import lru_cache

import numpy as np
from imgui_bundle import ImVec2, imgui
from jaxtyping import UInt8

from core.geometry.pixels import bounding_box
from core.models.photo_detail import PhotoView, decompressed
from viewer.context import PanelContext
from viewer.screen.theme import mixed, packed
from viewer.values import orbit


class Comparison:
    """The tool that shows the photo at the left of a line and the render at its right."""

    def __init__(self) -> None:
        self._line = 0.5  # place of the line as a fraction of the photo's width

    def draw(self, context: PanelContext, corner: ImVec2, size: ImVec2) -> bool:
        """Draw the photo over the view, imgui's last item; return whether the tool takes the mouse."""
        photo_rect = photo_place(context, corner, size)
        if photo_rect is None:
            return False
        view, low, high = photo_rect
        if imgui.is_item_active():
            self._line = min(1.0, max(0.0, (imgui.get_mouse_pos().x - low.x) / (high.x - low.x)))
        draw = imgui.get_window_draw_list()
        edge = low.x + self._line * (high.x - low.x)
        bottom = corner.y + size.y
        draw.push_clip_rect(corner, (edge, bottom), True)
        draw.add_rect_filled(corner, (edge, bottom), packed(mixed(*context.palette.background, 0.35)))
        draw.add_image(context.texture(photo_pixels(view.image)), low, high)
        draw.pop_clip_rect()
        draw.add_line((edge, corner.y), (edge, bottom), packed(context.palette.accent), 2.0)
        return True


def photo_place(context: PanelContext, corner: ImVec2, size: ImVec2) -> tuple[PhotoView, ImVec2, ImVec2] | None:
    """Return the photo of the object in the view and two opposite corners on screen, px.

    Returns None unless the view shows the scene from the photo's camera.
    """
    session = context.session
    if (view := session.photo_view) is None or session.viewport.source != "scene":
        return None
    offset = session.viewport.settings.offset
    box = orbit.photo_box(view.camera, session.editor.scene.camera, (size.x, size.y), offset)
    return (view, corner + ImVec2(*box[:2]), corner + ImVec2(*box[2:])) if box else None


photo_pixels = lru_cache(4)(decompressed)  # the same array for the same file, so that the file keeps its texture


@lru_cache(4)
def object_pixels(file: bytes) -> UInt8[np.ndarray, "height width 4"]:
    """Return the pixels of the object in a photo's file, the same array for the same file."""
    pixels = photo_pixels(file)
    left, top, right, bottom = bounding_box(pixels[..., 3] > 0)
    return pixels[top:bottom, left:right].copy()
