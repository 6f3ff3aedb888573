"""The welcome card: a sentence, a large button to open a photo, and sample photos."""

import math

from imgui_bundle import ImVec2, hello_imgui, icons_fontawesome_4, imgui

from viewer.context import PanelContext
from viewer.widgets import object_tiles
from viewer.widgets.controls import action_button, tooltip
from viewer.widgets.text import caption

_WIDEST, _MARGIN, _PADDING = 32.0, 0.7, 0.6  # em: width of the card, space around and within it
_SMALL, _SAMPLE = 11.0, 3.0  # em: width of the small card, and side of a sample photo
_LOW = 18.0  # em: in a lower view the large card would hide the object
_GAP, _LEAST = 0.6, 7.0  # em: gap between photos, and least width of the button beside them
_OPEN = f"{icons_fontawesome_4.ICON_FA_IMAGE}  Open photo…"


class Welcome:
    """A card at the bottom of the view until a photo or another file is opened."""

    def __init__(self) -> None:
        self.covered = 0.0  # px of the view's lower edge that the card took in the last frame

    @staticmethod
    def is_due(context: PanelContext) -> bool:
        """Return whether no photo or other object was opened yet."""
        fitting = context.session.fitting
        return not (context.session.editor.objects.added or fitting.pending or fitting.history.photo)

    def draw(self, context: PanelContext, corner: ImVec2, size: ImVec2) -> None:
        """Draw the card at the bottom of a rectangle, px on screen.

        The small card, at the right of the history, is drawn in a low rectangle and once the object was turned.
        """
        em = hello_imgui.em_size()
        small = bool(context.session.editor.history.past) or size.y < _LOW * em
        width = min((_SMALL if small else _WIDEST) * em, size.x - 2 * _MARGIN * em)
        context.card_width = width + _MARGIN * em if small else 0.0
        left = size.x - width - _MARGIN * em if small else (size.x - width) / 2  # beside the badge, if any
        imgui.set_cursor_screen_pos(ImVec2(corner.x + left, corner.y + max(0.0, size.y - self.covered)))
        imgui.push_style_color(imgui.Col_.child_bg, (*context.palette.panel, 0.94))
        imgui.push_style_var(imgui.StyleVar_.window_padding, (_PADDING * em, _PADDING * em))
        flags = imgui.ChildFlags_
        shape = flags.auto_resize_y | flags.always_use_window_padding
        # The arrow keys turn the object, so they must not move the focus within the card.
        if imgui.begin_child("welcome", (width, 0), shape, imgui.WindowFlags_.no_nav):
            self._draw_open(context, small)
            draw_samples(context, _SAMPLE * em)
        imgui.end_child()
        self.covered = imgui.get_item_rect_size().y + _MARGIN * em
        imgui.pop_style_var()
        imgui.pop_style_color()

    def _draw_open(self, context: PanelContext, small: bool) -> None:
        """Draw the sentence, and the button left of the photos, so that the card is low."""
        if small:
            action_button(context, "fit_image", _OPEN, -1, context.palette.accent)
            return
        caption(context, f"Drop a photo of {nouns(context)}, or open one: it becomes a 3-D object.")
        em = hello_imgui.em_size()
        photos = len(context.session.samples) * (_SAMPLE + _GAP)
        imgui.push_style_var(imgui.StyleVar_.frame_padding, (0.5 * em, (_SAMPLE - 1) / 2 * em))
        width = imgui.get_content_region_avail().x / em - photos
        is_wide = width > _LEAST
        action_button(context, "fit_image", _OPEN, width if is_wide else -1, context.palette.accent)
        imgui.pop_style_var()
        if is_wide:
            imgui.same_line(0, _GAP * em)


def nouns(context: PanelContext) -> str:
    """Return the nouns of all open models in words: "a chair or a car"."""
    return " or ".join(dict.fromkeys(f"a {model.noun or 'thing'}" for model in context.session.models))


def draw_samples(context: PanelContext, largest: float = math.inf) -> None:
    """Draw the sample photos in one or two lines; a click fits a photo.

    Args:
        largest: limit of a photo's side, px.
    """
    em = hello_imgui.em_size()
    gap = _GAP * hello_imgui.em_size()
    paths = context.session.samples
    room = imgui.get_content_region_avail().x
    if not paths:
        return
    needed = len(paths) * (_SAMPLE * em + gap) - gap
    columns = len(paths) if room > needed - 1 else -(-len(paths) // 2)  # half a pixel may be lost to rounding
    side = min(object_tiles.THUMBNAIL * em, (room - gap * (columns - 1)) / columns, largest)
    for number, path in enumerate(paths):
        if number % columns:
            imgui.same_line(0, gap)
        corner = imgui.get_cursor_screen_pos()
        if object_tiles.tile_button(f"sample {path.stem}", (side, side)):
            context.fit(path)
        hovered = imgui.is_item_hovered()
        tooltip(f"Fit this photo: {path.stem}")
        object_tiles.paint_photo(context, path, corner, side)
        object_tiles.outline(corner, side, context.palette.accent if hovered else context.palette.line)
