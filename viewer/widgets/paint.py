"""Controls of the object's paint: swatches, a square of colours, an eyedropper, and the original paint."""

import numpy as np
from imgui_bundle import ImVec2, hello_imgui, icons_fontawesome_4, imgui
from jaxtyping import UInt8

from core.edits.paint import Rgb
from viewer.context import PanelContext
from viewer.screen.theme import packed
from viewer.values.paints import as_paint, paints_of, rgb, square_colour
from viewer.widgets.controls import button, choose, tooltip

_DROP = icons_fontawesome_4.ICON_FA_EYE_DROPPER
_BACK = icons_fontawesome_4.ICON_FA_UNDO
_SWATCH, _ACROSS = 1.45, 6  # em, height of a swatch; swatches in a line
_SQUARE = (12.0, 7.0)  # em, size of the square of colours
_CELLS = (41, 24)  # of the square of colours
_SHADE = "Any other colour: drag in the square"
_PICK = "Take a colour from the photo or the view: click there"


def draw_paint(context: PanelContext) -> None:
    """Draw part, colour, eyedropper and original paint in a line, above swatches."""
    painting = context.session.painting
    imgui.align_text_to_frame_padding()
    imgui.text("Paint")
    if len(painting.parts) > 1:
        imgui.same_line()
        labels = {part: part.capitalize() for part in painting.parts}
        painting.part = choose("paint part", painting.part, labels, "The part that is painted", 6)
    imgui.same_line()
    if _draw_swatch("paint", painting.colour or (0.5, 0.5, 0.5), _SHADE, 2 * _SWATCH * hello_imgui.em_size()):
        imgui.open_popup("shades")
    draw_colour_popup(context, "shades")
    imgui.same_line()
    if button(f"{_DROP}###pick colour", _PICK):
        context.tool = "turn" if context.tool == "pick" else "pick"
    imgui.same_line()
    if button(f"{_BACK}###original paint", "Back to the original paint", enabled=not painting.is_original):
        painting.restore()
    _draw_swatches(context, imgui.get_content_region_avail().x)


def draw_colour_popup(context: PanelContext, name: str, swatches: bool = False) -> None:
    """Draw the popup of the part's colours if it is open: the square and, if asked, swatches above it."""
    painting = context.session.painting
    if imgui.begin_popup(name):
        if imgui.is_window_appearing():
            painting.popup_part = painting.part
        elif painting.part != painting.popup_part:  # after an undo, say, which shows another object
            imgui.close_current_popup()
        if swatches:
            imgui.text(painting.part.capitalize())
            _draw_swatches(context, _SQUARE[0] * hello_imgui.em_size())
        _draw_square(context)
        imgui.end_popup()
    elif not imgui.is_mouse_down(imgui.MouseButton_.left):
        painting.release()  # a drag that ended with the square


def _draw_swatches(context: PanelContext, room: float) -> None:
    """Draw twelve paints that suit the part, and those chosen last, in lines of ``room`` px; a click paints."""
    latest = {f"Chosen before, {paint}": paint for paint in context.preferences.paints}
    gap = 0.3 * hello_imgui.em_size()
    width = (room - gap * (_ACROSS - 1)) / _ACROSS
    imgui.push_style_var(imgui.StyleVar_.item_spacing, (gap, gap))
    for number, (name, paint) in enumerate({**paints_of(context.session.painting.part), **latest}.items()):
        if number % _ACROSS:
            imgui.same_line()
        if _draw_swatch(f"swatch {number + 1}", rgb(paint), name, width):
            _paint(context, rgb(paint))
    imgui.pop_style_var()


def _draw_swatch(name: str, colour: Rgb, text: str, width: float) -> bool:
    """Draw a button of a colour, ``width`` px wide, with a tooltip; return True if pressed."""
    flags = imgui.ColorEditFlags_.no_tooltip | imgui.ColorEditFlags_.no_drag_drop
    size = ImVec2(width, _SWATCH * hello_imgui.em_size())
    pressed = imgui.color_button(f"###{name}", imgui.ImVec4(*colour, 1.0), flags, size)
    tooltip(text)
    return pressed


def _draw_square(context: PanelContext) -> None:
    """Draw the square of colours: the view follows a drag over it."""
    width, height = _SQUARE
    columns, rows = _CELLS
    em = hello_imgui.em_size()
    corner = imgui.get_cursor_screen_pos()
    size = ImVec2(width, height) * em
    imgui.invisible_button("square", size)
    cell = ImVec2(size.x / columns, size.y / rows)
    draw = imgui.get_window_draw_list()
    for column in range(columns):
        for row in range(rows):
            low = corner + ImVec2(column * cell.x, row * cell.y)
            colour = square_colour((column + 0.5) / columns, (row + 0.5) / rows)
            draw.add_rect_filled(low, low + cell, packed(colour))
    painting = context.session.painting
    offset = imgui.get_mouse_pos() - corner
    if imgui.is_item_active():
        x, y = (max(0.0, min(1.0, px / side)) for px, side in zip(offset, size, strict=True))
        painting.paint(square_colour(x, y))
        draw.add_circle(corner + ImVec2(x * size.x, y * size.y), 0.4 * em, packed((1, 1, 1)), thickness=2.0)
    elif imgui.is_item_deactivated() and painting.colour and not imgui.is_key_pressed(imgui.Key.escape):
        _paint(context, painting.colour)


def _paint(context: PanelContext, colour: Rgb) -> None:
    """Give the part a colour, and remember it among those chosen last unless it is a swatch."""
    painting = context.session.painting
    paint = as_paint(colour)
    painting.paint(colour)
    painting.release()
    if paint not in paints_of(painting.part).values():
        context.preferences = context.preferences.with_paint(paint)


def pick_in_view(context: PanelContext, corner: ImVec2, size: ImVec2) -> bool:
    """Pick a colour of the view, imgui's last item; always take the mouse."""
    if frame := context.session.viewport.frame:
        pick(context, frame.image, corner, size)
    return True


def pick(
    context: PanelContext, pixels: UInt8[np.ndarray, "height width channels"], corner: ImVec2, size: ImVec2
) -> None:
    """Show the colour under the mouse over an image, imgui's last item; on a click, paint with it.

    Nothing happens unless the eyedropper is the current tool.
    """
    if context.tool != "pick" or not imgui.is_item_hovered():
        return
    offset = imgui.get_mouse_pos() - corner
    height, width = pixels.shape[:2]
    column = int(offset.x / size.x * width)
    row = int(offset.y / size.y * height)
    colour = pixels[max(0, min(height - 1, row)), max(0, min(width - 1, column)), :3] / 255.0
    em = hello_imgui.em_size()
    low = imgui.get_mouse_pos() + ImVec2(0.8 * em, -1.8 * em)
    draw = imgui.get_foreground_draw_list()
    rgb = (float(colour[0]), float(colour[1]), float(colour[2]))
    draw.add_rect_filled(low, low + ImVec2(em, em), packed(rgb), 0.2 * em)
    draw.add_rect(low, low + ImVec2(em, em), packed(context.palette.text), 0.2 * em)
    if imgui.is_item_clicked(imgui.MouseButton_.left):
        context.tool = "turn"
        _paint(context, rgb)
