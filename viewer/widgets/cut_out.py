"""A photo as wide as its panel, with numbered boxes of detected objects to click."""

from collections.abc import Callable, Sequence

import numpy as np
from imgui_bundle import ImVec2, imgui
from jaxtyping import UInt8

from core.photos.detector import Box
from viewer.context import PanelContext
from viewer.screen.theme import packed
from viewer.widgets.controls import tooltip
from viewer.widgets.object_tiles import mark, rounding, tile_button
from viewer.widgets.paint import pick

_TALLEST = 0.5  # largest height of the photo as a fraction of the panel's


def draw_cut_out(
    context: PanelContext,
    pixels: UInt8[np.ndarray, "height width channels"],
    boxes: Sequence[Box],
    choose: Callable[[int], None],
) -> None:
    """Draw the photo and, unless there is only one, the boxes; a click calls ``choose`` with the box's index."""
    height, width = pixels.shape[:2]
    room = imgui.get_content_region_avail().x
    scale = min(room / width, _TALLEST * imgui.get_window_height() / height)
    size = ImVec2(width * scale, height * scale)
    corner = imgui.get_cursor_screen_pos()
    corner += ImVec2((room - size.x) / 2, 0)
    imgui.set_cursor_screen_pos(corner)
    draw = imgui.get_window_draw_list()
    draw.add_image_rounded(context.texture(pixels), corner, corner + size, (0, 0), (1, 1), 0xFFFFFFFF, rounding())
    if context.tool != "pick" and len(boxes) > 1:  # smaller boxes first, as larger ones contain them
        for number, box in sorted(enumerate(boxes), key=lambda item: _area(item[1])):
            _draw_box(context, number, box, (corner, size), choose)
    imgui.set_cursor_screen_pos(corner)
    imgui.invisible_button("photo", size)
    pick(context, pixels, corner, size)


def _area(box: Box) -> float:
    left, top, right, bottom = box
    return (right - left) * (bottom - top)


def _draw_box(
    context: PanelContext, number: int, box: Box, rectangle: tuple[ImVec2, ImVec2], choose: Callable[[int], None]
) -> None:
    corner, size = rectangle
    low, high = (corner + ImVec2(x * size.x, y * size.y) for x, y in (box[:2], box[2:]))
    imgui.set_cursor_screen_pos(low)
    if tile_button(f"object {number + 1}", high - low):
        choose(number)
    colour = context.palette.accent if imgui.is_item_hovered() else context.palette.warm
    tooltip("Fit this one")
    imgui.get_window_draw_list().add_rect(low, high, packed(colour), rounding(), thickness=2.0)
    mark(low, str(number + 1), colour)
