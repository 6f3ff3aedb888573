"""A photo as wide as its panel, with numbered boxes of detected objects to click."""

from collections.abc import Callable, Sequence

import numpy as np
from imgui_bundle import ImVec2, hello_imgui, imgui
from jaxtyping import UInt8

from core.photos.detector import Box
from viewer.context import PanelContext
from viewer.screen.theme import packed
from viewer.widgets.controls import tooltip
from viewer.widgets.object_tiles import MARK, mark, rounding, tile_button
from viewer.widgets.paint import pick

_TALLEST = 0.5  # largest height of the photo as a fraction of the panel's


def draw_cut_out(
    context: PanelContext,
    pixels: UInt8[np.ndarray, "height width channels"],
    boxes: Sequence[Box],
    choose: Callable[[Box], None],
) -> None:
    """Draw the photo and, unless there is only one, the boxes; a click calls ``choose`` with a box."""
    height, width = pixels.shape[:2]
    room = imgui.get_content_region_avail().x
    scale = min(room / width, _TALLEST * imgui.get_window_height() / height)
    size = ImVec2(width * scale, height * scale)
    corner = imgui.get_cursor_screen_pos()
    corner += ImVec2((room - size.x) / 2, 0)
    imgui.set_cursor_screen_pos(corner)
    draw = imgui.get_window_draw_list()
    draw.add_image_rounded(context.texture(pixels), corner, corner + size, (0, 0), (1, 1), 0xFFFFFFFF, rounding())
    if context.tool != "pick" and len(boxes) > 1:
        _draw_boxes(context, boxes, corner, size, choose)
    imgui.set_cursor_screen_pos(corner)
    imgui.invisible_button("photo", size)
    pick(context, pixels, corner, size)


def _area(box: Box) -> float:
    left, top, right, bottom = box
    return (right - left) * (bottom - top)


def _draw_boxes(
    context: PanelContext, boxes: Sequence[Box], corner: ImVec2, size: ImVec2, choose: Callable[[Box], None]
) -> None:
    """Draw boxes with their numbers. Numbers take the mouse first, then smaller boxes, as larger ones contain them."""
    lows = [corner + ImVec2(left * size.x, top * size.y) for left, top, *_ in boxes]
    highs = [corner + ImVec2(right * size.x, bottom * size.y) for *_, right, bottom in boxes]
    mark_size = ImVec2(MARK, MARK) * hello_imgui.em_size()
    marks = _apart(lows, mark_size)
    by_area = sorted(range(len(boxes)), key=lambda number: _area(boxes[number]))
    buttons = [
        *(("number", number, marks[number], mark_size) for number in range(len(boxes))),
        *(("object", number, lows[number], highs[number] - lows[number]) for number in by_area),
    ]
    pointed = -1
    for kind, number, low, extent in buttons:
        imgui.set_cursor_screen_pos(low)
        if tile_button(f"{kind} {number + 1}", extent):
            choose(boxes[number])
        tooltip("Fit this one")
        pointed = number if pointed < 0 and imgui.is_item_hovered() else pointed
    for number, (low, high) in enumerate(zip(lows, highs, strict=True)):
        colour = context.palette.accent if number == pointed else context.palette.warm
        imgui.get_window_draw_list().add_rect(low, high, packed(colour), rounding(), thickness=2.0)
        mark(marks[number], str(number + 1), colour)


def _apart(corners: Sequence[ImVec2], size: ImVec2) -> list[ImVec2]:
    """Return the corners of rectangles, moved to the right where they would overlap earlier ones."""
    moved = list[ImVec2]()
    for corner in corners:
        while any(abs(corner.x - earlier.x) < size.x and abs(corner.y - earlier.y) < size.y for earlier in moved):
            corner += ImVec2(size.x, 0)
        moved.append(corner)
    return moved
