"""A photo and the render of its fit: side by side, one wiped over the other, or their difference."""

import numpy as np
from imgui_bundle import ImVec2, hello_imgui, imgui

from viewer.desk import Desk, tip
from viewer.theme import packed

_MODES = ("Side by side", "Wipe", "Difference")
_WHITE = (1.0, 1.0, 1.0)


class Comparison:
    """Which of the three it is, and where the wipe stands."""

    def __init__(self) -> None:
        self._mode = _MODES[0]
        self._wipe = 0.5
        """0 shows the render alone, 1 the photo alone"""

    def draw(self, desk: Desk, height: float) -> None:
        """The choice, and below it the picture or pictures, so many px high at the most."""
        for number, mode in enumerate(_MODES):
            if number:
                imgui.same_line()
            if imgui.radio_button(mode, self._mode == mode):
                self._mode = mode
        course, room = desk.session.fitting.course, imgui.get_content_region_avail().x
        height = max(3 * hello_imgui.em_size(), height - imgui.get_frame_height_with_spacing())
        if self._mode == _MODES[0]:
            gap = imgui.get_style().item_spacing.x
            side = min((room - gap) / 2, height)
            corner = _reserve("side by side", ImVec2(2 * side + gap, side), room)
            _draw_picture(desk, "Photo", course.pixels, corner, side)
            _draw_picture(desk, "Render", course.shown, corner + ImVec2(side + gap, 0), side)
            return
        side = min(room, height)
        corner = _reserve(self._mode.lower(), ImVec2(side, side), room)
        if self._mode == "Wipe":
            self._draw_wipe(desk, corner, side)
        else:
            tip("Black where photo and render agree; twice the difference elsewhere")
            _draw_picture(desk, "", course.difference, corner, side)

    def _draw_wipe(self, desk: Desk, corner: ImVec2, side: float) -> None:
        if imgui.is_item_active():
            self._wipe = min(1.0, max(0.0, (imgui.get_mouse_pos().x - corner.x) / side))
        else:
            tip("Drag: the photo is on the left, the render on the right")
        course = desk.session.fitting.course
        _draw_picture(desk, "Render", course.shown, corner, side, to_right=True)
        draw, edge = imgui.get_window_draw_list(), corner.x + self._wipe * side
        draw.push_clip_rect(corner, (edge, corner.y + side), True)
        _draw_picture(desk, "Photo", course.pixels, corner, side)
        draw.pop_clip_rect()
        draw.add_line((edge, corner.y), (edge, corner.y + side), packed(desk.palette.accent), 2.0)


def _reserve(name: str, size: ImVec2, room: float) -> ImVec2:
    """A place in the middle that takes the mouse; its corner."""
    imgui.set_cursor_pos_x(imgui.get_cursor_pos_x() + max(0.0, (room - size.x) / 2))
    corner = imgui.get_cursor_screen_pos()
    imgui.invisible_button(name, size)
    return corner


def _draw_picture(
    desk: Desk, caption: str, pixels: np.ndarray | None, corner: ImVec2, side: float, to_right: bool = False
) -> None:
    draw, em = imgui.get_window_draw_list(), hello_imgui.em_size()
    opposite = corner + ImVec2(side, side)
    draw.add_rect_filled(corner, opposite, packed(_WHITE), 0.3 * em)
    if pixels is not None and desk.images is not None:
        texture = desk.images.texture(pixels, desk.palette)
        draw.add_image_rounded(texture, corner, opposite, (0, 0), (1, 1), packed(_WHITE), 0.3 * em)
    across = side - imgui.calc_text_size(caption).x - 0.5 * em if to_right else 0.5 * em
    draw.add_text(corner + ImVec2(across, 0.3 * em), packed((0.38, 0.38, 0.38)), caption)
