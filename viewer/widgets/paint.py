"""Controls of the object's paint: its colour, an eyedropper, and the original paint."""

import numpy as np
from imgui_bundle import ImVec2, hello_imgui, icons_fontawesome_4, imgui
from jaxtyping import UInt8

from viewer.context import PanelContext
from viewer.screen.theme import packed
from viewer.widgets.controls import button, choose

_DROP, _BACK = icons_fontawesome_4.ICON_FA_EYE_DROPPER, icons_fontawesome_4.ICON_FA_UNDO
_FLAGS = imgui.ColorEditFlags_.no_inputs | imgui.ColorEditFlags_.picker_hue_wheel


def draw_paint(context: PanelContext) -> None:
    """Draw a line of controls: part, colour, eyedropper, original paint."""
    painting = context.session.painting
    imgui.align_text_to_frame_padding()
    imgui.text("Paint")
    imgui.begin_disabled("texture" in context.session.editor.locked)
    if len(painting.parts) > 1:
        imgui.same_line()
        parts = {part: part.capitalize() for part in painting.parts}
        painting.part = choose("paint part", painting.part, parts, "The part that is painted", 6)
    imgui.same_line()
    changed, colour = imgui.color_edit3("###paint", list(painting.colour or (0.5, 0.5, 0.5)), _FLAGS)
    imgui.set_item_tooltip("Give it another colour; lettering, lamps, glass and wheels of the photo stay")
    if changed:
        painting.paint((colour[0], colour[1], colour[2]))
    if not imgui.is_mouse_down(imgui.MouseButton_.left):
        painting.release()
    imgui.same_line()
    if button(f"{_DROP}###pick colour", "Take a colour from the photo or the view: click there"):
        context.tool = "turn" if context.tool == "pick" else "pick"
    imgui.same_line()
    if button(f"{_BACK}###original paint", "Back to the original paint", enabled=not painting.is_original):
        painting.restore()
    imgui.end_disabled()


class Eyedropper:
    """The tool that paints with a colour of the view."""

    def draw(self, context: PanelContext, corner: ImVec2, size: ImVec2) -> bool:
        """Show the colour under the mouse over the view, imgui's last item; always take the mouse."""
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
    share, (height, width) = imgui.get_mouse_pos() - corner, pixels.shape[:2]
    column, row = int(share.x / size.x * width), int(share.y / size.y * height)
    colour = pixels[max(0, min(height - 1, row)), max(0, min(width - 1, column)), :3] / 255.0
    em = hello_imgui.em_size()
    low = imgui.get_mouse_pos() + ImVec2(0.8 * em, -1.8 * em)
    draw, rgb = imgui.get_foreground_draw_list(), (float(colour[0]), float(colour[1]), float(colour[2]))
    draw.add_rect_filled(low, low + ImVec2(em, em), packed(rgb), 0.2 * em)
    draw.add_rect(low, low + ImVec2(em, em), packed(context.palette.text), 0.2 * em)
    if imgui.is_item_clicked(imgui.MouseButton_.left):
        context.tool = "turn"
        context.session.painting.paint(rgb)
        context.session.painting.release()
