"""Text in two styles beside the usual one: headings, and small, quiet captions."""

from bisect import bisect_right

from imgui_bundle import ImVec2, hello_imgui, imgui

from viewer.context import PanelContext
from viewer.screen.theme import HEADING, ON_PLATE, PLATE, PLATE_OPACITY, SMALL, packed
from viewer.values.printable import printable

_LONGEST = 500  # characters of a caption that are looked at, more than fit anywhere


def heading(context: PanelContext, words: str) -> None:
    """Draw bold text, a little larger."""
    imgui.push_font(context.bold, HEADING * imgui.get_style().font_size_base)
    imgui.text_wrapped(words)
    imgui.pop_font()


def caption(context: PanelContext, words: str) -> None:
    """Draw small, quiet text, wrapped at the end of the line."""
    push_small()
    imgui.push_style_color(imgui.Col_.text, (*context.palette.quiet, 1.0))
    imgui.text_wrapped(words)
    imgui.pop_style_color()
    imgui.pop_font()


def push_small() -> None:
    """Make text small until imgui's ``pop_font``."""
    imgui.push_font(None, SMALL * imgui.get_style().font_size_base)


def shortened(words: str, width: float) -> str:
    """Return text in the current font that is at most ``width`` px wide, with an ellipsis if it was longer."""
    words = printable(words)[:_LONGEST]
    if imgui.calc_text_size(words).x <= width:
        return words
    counts = range(1, len(words) + 1)
    count = bisect_right(counts, width, key=lambda count: imgui.calc_text_size(f"{words[:count]}…").x)
    return f"{words[:count]}…"


def paint_caption(
    context: PanelContext, words: str, corner: ImVec2, width: float, across: float = 0.5, quiet: bool = True
) -> None:
    """Draw a caption at a corner on screen, shortened to ``width`` px, without an imgui item.

    Args:
        across: alignment within the width, from left (0) to right (1).
        quiet: less contrast than usual text has.
    """
    push_small()
    words = shortened(words, width)
    low = corner + ImVec2(across * (width - imgui.calc_text_size(words).x), 0)
    colour = context.palette.quiet if quiet else context.palette.text
    imgui.get_window_draw_list().add_text(low, packed(colour), words)
    imgui.pop_font()


def paint_on_plate(low: ImVec2, text: str, pad: ImVec2, width: float = 0.0) -> None:
    """Draw text on a dark plate over the view, without an imgui item.

    Args:
        low: upper left corner of the text on screen.
        pad: px of the plate around the text.
        width: px at which lines are wrapped; 0 wraps none.
    """
    draw = imgui.get_window_draw_list()
    extent = imgui.calc_text_size(text, wrap_width=width or -1.0)
    draw.add_rect_filled(low - pad, low + extent + pad, packed(PLATE, PLATE_OPACITY), 0.4 * hello_imgui.em_size())
    draw.add_text(imgui.get_font(), imgui.get_font_size(), low, packed(ON_PLATE), text, wrap_width=width)


def small_height() -> float:
    """Return the height of a caption's line in px."""
    return SMALL * imgui.get_text_line_height()
