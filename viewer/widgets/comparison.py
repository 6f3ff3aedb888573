"""A photo and the render of its fit, cropped to the object: both, wiped, laid over each other, or their difference."""

import numpy as np
from imgui_bundle import ImVec2, hello_imgui, imgui

from viewer.context import PanelContext
from viewer.screen.theme import packed
from viewer.widgets.controls import draw_choice, tooltip

_MODES = ("Both", "Wipe", "Onion skin", "Difference")
_WHITE = (1.0, 1.0, 1.0)
_FLICKER = imgui.Key.f


class Comparison:
    """Which of the four it is, and the positions of wipe and onion skin."""

    def __init__(self) -> None:
        self._mode = _MODES[0]
        self._share = 0.5  # 0 shows the render alone, 1 the photo alone

    def draw_choice(self) -> None:
        """A line of modes."""
        self._mode = draw_choice({mode: mode for mode in _MODES}, self._mode)

    def draw(self, context: PanelContext, height: float) -> None:
        """The images, as large as the panel's width and so many px of height allow."""
        room, photo = imgui.get_content_region_avail().x, context.session.fitting.history.photo
        limits = ImVec2(room, max(3 * hello_imgui.em_size(), height))
        left, top, right, bottom = photo.part if photo else (0.0, 0.0, 1.0, 1.0)
        ratio = (right - left) / (bottom - top)
        held = imgui.is_key_down(_FLICKER) and not imgui.get_io().want_text_input
        if self._mode == _MODES[0]:
            self._draw_pair(context, limits, ratio, held)
            return
        size = _largest(limits, ratio)
        corner = _reserve(self._mode.lower(), size, room)
        if held:
            _draw_photo(context, corner, size)
        elif self._mode == "Difference":
            tooltip("Black where photo and render agree; twice the difference elsewhere")
            _draw_image(context, "", context.session.fitting.history.difference, corner, size)
        else:
            self._draw_both(context, corner, size)

    def _draw_pair(self, context: PanelContext, limits: ImVec2, ratio: float, held: bool) -> None:
        """The photo over the render, or beside it where both are larger so."""
        gap = 0.25 * hello_imgui.em_size()
        above, beside = ImVec2(limits.x, (limits.y - gap) / 2), ImVec2((limits.x - gap) / 2, limits.y)
        stacked, side = _largest(above, ratio), _largest(beside, ratio)
        below = stacked.x > side.x
        size = stacked if below else side
        second = ImVec2(0, size.y + gap) if below else ImVec2(size.x + gap, 0)
        corner = _reserve("both", size + second, limits.x)
        tooltip("Hold F: the photo in place of the render")
        _draw_photo(context, corner, size)
        (_draw_photo if held else _draw_render)(context, corner + second, size)

    def _draw_both(self, context: PanelContext, corner: ImVec2, size: ImVec2) -> None:
        if imgui.is_item_active():
            self._share = min(1.0, max(0.0, (imgui.get_mouse_pos().x - corner.x) / size.x))
        elif self._mode == "Wipe":
            tooltip("Drag: the photo is on the left, the render on the right. Hold F: the photo alone")
        else:
            tooltip("Drag: the farther right, the more of the photo. Hold F: the photo alone")
        draw, edge = imgui.get_window_draw_list(), corner.x + self._share * size.x
        if self._mode == "Onion skin":
            history = context.session.fitting.history
            _draw_image(context, "", history.image, corner, size)
            _draw_image(context, "", history.photo.pixels if history.photo else None, corner, size, share=self._share)
            return
        _draw_render(context, corner, size)
        draw.push_clip_rect(corner, (edge, corner.y + size.y), True)
        _draw_photo(context, corner, size)
        draw.pop_clip_rect()
        draw.add_line((edge, corner.y), (edge, corner.y + size.y), packed(context.palette.accent), 2.0)


def _largest(limits: ImVec2, ratio: float) -> ImVec2:
    """The largest rectangle of this width by height within limits (px)."""
    width = min(limits.x, limits.y * ratio)
    return ImVec2(width, width / ratio)


def _reserve(name: str, size: ImVec2, room: float) -> ImVec2:
    """A place in the middle that takes the mouse; its corner."""
    imgui.set_cursor_pos_x(imgui.get_cursor_pos_x() + max(0.0, (room - size.x) / 2))
    corner = imgui.get_cursor_screen_pos()
    imgui.invisible_button(name, size)
    return corner


def _draw_photo(context: PanelContext, corner: ImVec2, size: ImVec2) -> None:
    view = context.session.fitting.history.photo
    _draw_image(context, "Photo", view.pixels if view else None, corner, size)


def _draw_render(context: PanelContext, corner: ImVec2, size: ImVec2) -> None:
    """Its caption is at the right, where a wipe shows it."""
    _draw_image(context, "Render", context.session.fitting.history.image, corner, size, to_right=True)


def _draw_image(
    context: PanelContext,
    caption: str,
    pixels: np.ndarray | None,
    corner: ImVec2,
    size: ImVec2,
    to_right: bool = False,
    share: float = 1.0,
) -> None:
    draw, em = imgui.get_window_draw_list(), hello_imgui.em_size()
    opposite = corner + size
    if pixels is not None and context.images is not None:
        texture = context.images.texture(pixels, context.palette)
        photo = context.session.fitting.history.photo
        part = photo.part if photo else (0.0, 0.0, 1.0, 1.0)
        draw.add_image_rounded(texture, corner, opposite, part[:2], part[2:], packed(_WHITE, share), 0.3 * em)
    else:
        draw.add_rect_filled(corner, opposite, packed(_WHITE, share), 0.3 * em)
    width = imgui.calc_text_size(caption).x
    across = size.x - width - 0.5 * em if to_right else 0.5 * em
    if caption and 2 * width < size.x:
        draw.add_text(corner + ImVec2(across, 0.3 * em), packed((0.38, 0.38, 0.38)), caption)
