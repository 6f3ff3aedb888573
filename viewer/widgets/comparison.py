"""A photo and the render of its fit: side by side, wiped, laid over each other, or their difference."""

import numpy as np
from imgui_bundle import ImVec2, hello_imgui, imgui

from viewer.context import PanelContext
from viewer.screen.theme import packed
from viewer.widgets.controls import tooltip

_MODES = ("Side by side", "Wipe", "Onion skin", "Difference")
_WHITE = (1.0, 1.0, 1.0)
_FLICKER = imgui.Key.f


class Comparison:
    """Which of the four it is, and the positions of wipe and onion skin."""

    def __init__(self) -> None:
        self._mode = _MODES[0]
        self._share = 0.5
        """0 shows the render alone, 1 the photo alone"""

    def draw_choice(self) -> None:
        """A line of modes."""
        gap = imgui.get_style().item_spacing.x  # half of it, on either side, is in the colour of the chosen one
        imgui.set_cursor_pos_x(imgui.get_cursor_pos_x() + gap / 2)
        for number, mode in enumerate(_MODES):
            if number:
                imgui.same_line(0, gap)
                if imgui.get_content_region_avail().x < imgui.calc_text_size(mode).x + gap:
                    imgui.new_line()
                    imgui.set_cursor_pos_x(imgui.get_cursor_pos_x() + gap / 2)
            if imgui.selectable(mode, self._mode == mode, size=ImVec2(imgui.calc_text_size(mode).x, 0))[0]:
                self._mode = mode

    def draw(self, context: PanelContext, height: float) -> None:
        """The images, so many px high at the most."""
        height = max(3 * hello_imgui.em_size(), height)
        room = imgui.get_content_region_avail().x
        held = imgui.is_key_down(_FLICKER) and not imgui.get_io().want_text_input
        if self._mode == _MODES[0]:
            self._draw_beside(context, room, height, held)
            return
        side = min(room, height)
        corner = _reserve(self._mode.lower(), ImVec2(side, side), room)
        if held:
            _draw_photo(context, corner, side)
        elif self._mode == "Difference":
            tooltip("Black where photo and render agree; twice the difference elsewhere")
            _draw_image(context, "", context.fitting.history.difference, corner, side)
        else:
            self._draw_both(context, corner, side)

    def _draw_beside(self, context: PanelContext, room: float, height: float, held: bool) -> None:
        gap = imgui.get_style().item_spacing.x
        side = min((room - gap) / 2, height)
        corner = _reserve("side by side", ImVec2(2 * side + gap, side), room)
        tooltip("Hold F: the photo in place of the render")
        _draw_photo(context, corner, side)
        right = corner + ImVec2(side + gap, 0)
        _draw_photo(context, right, side) if held else _draw_render(context, right, side)

    def _draw_both(self, context: PanelContext, corner: ImVec2, side: float) -> None:
        if imgui.is_item_active():
            self._share = min(1.0, max(0.0, (imgui.get_mouse_pos().x - corner.x) / side))
        elif self._mode == "Wipe":
            tooltip("Drag: the photo is on the left, the render on the right. Hold F: the photo alone")
        else:
            tooltip("Drag: the farther right, the more of the photo. Hold F: the photo alone")
        draw, edge = imgui.get_window_draw_list(), corner.x + self._share * side
        if self._mode == "Onion skin":
            history = context.fitting.history
            _draw_image(context, "", history.image, corner, side)
            _draw_image(context, "", history.photo.pixels if history.photo else None, corner, side, share=self._share)
            return
        _draw_render(context, corner, side)
        draw.push_clip_rect(corner, (edge, corner.y + side), True)
        _draw_photo(context, corner, side)
        draw.pop_clip_rect()
        draw.add_line((edge, corner.y), (edge, corner.y + side), packed(context.palette.accent), 2.0)


def _reserve(name: str, size: ImVec2, room: float) -> ImVec2:
    """A place in the middle that takes the mouse; its corner."""
    imgui.set_cursor_pos_x(imgui.get_cursor_pos_x() + max(0.0, (room - size.x) / 2))
    corner = imgui.get_cursor_screen_pos()
    imgui.invisible_button(name, size)
    return corner


def _draw_photo(context: PanelContext, corner: ImVec2, side: float) -> None:
    view = context.fitting.history.photo
    _draw_image(context, "Photo", view.pixels if view else None, corner, side)


def _draw_render(context: PanelContext, corner: ImVec2, side: float) -> None:
    """Its caption is at the right, where a wipe shows it."""
    _draw_image(context, "Render", context.fitting.history.image, corner, side, to_right=True)


def _draw_image(
    context: PanelContext,
    caption: str,
    pixels: np.ndarray | None,
    corner: ImVec2,
    side: float,
    to_right: bool = False,
    share: float = 1.0,
) -> None:
    draw, em = imgui.get_window_draw_list(), hello_imgui.em_size()
    opposite = corner + ImVec2(side, side)
    if pixels is not None and context.images is not None:
        texture = context.images.texture(pixels, context.palette)
        draw.add_image_rounded(texture, corner, opposite, (0, 0), (1, 1), packed(_WHITE, share), 0.3 * em)
    else:
        draw.add_rect_filled(corner, opposite, packed(_WHITE, share), 0.3 * em)
    width = imgui.calc_text_size(caption).x
    across = side - width - 0.5 * em if to_right else 0.5 * em
    if caption and 2 * width < side:
        draw.add_text(corner + ImVec2(across, 0.3 * em), packed((0.38, 0.38, 0.38)), caption)
