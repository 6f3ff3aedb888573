"""Parts of object tiles: thumbnail, border, a letter in the corner, drag and drop."""

from pathlib import Path

import numpy as np
from imgui_bundle import ImVec2, hello_imgui, imgui

from core.detail.progressive import Frame
from core.models.model import Instance
from viewer.context import PanelContext
from viewer.screen.theme import Colour, on, packed
from viewer.services.messages import Button, MessageKind
from viewer.values.printable import as_label

THUMBNAIL = 4.5  # em, side of most thumbnails: 72 px at the default text size
MARK = 1.2  # em, side of a mark
DIMMED = 0.55  # opacity of the shade over stale tiles
DRAGGED = "object"  # type of imgui's payload for an object dragged onto B


def paint(context: PanelContext, instance: Instance, corner: ImVec2, side: float) -> None:
    """Draw an object's thumbnail in a square of ``side`` px, empty until it is rendered."""
    paint_frame(context, context.session.thumbnails.of_object(instance), corner, side)


def paint_frame(context: PanelContext, image: Frame | np.ndarray | None, corner: ImVec2, side: float) -> None:
    """Draw a frame or RGB pixels in a square of ``side`` px with round corners, empty for None."""
    draw = imgui.get_window_draw_list()
    opposite = corner + ImVec2(side, side)
    if image is None:
        shade(corner, side, context.palette.raised)
        return
    draw.add_image_rounded(context.texture(image), corner, opposite, (0, 0), (1, 1), 0xFFFFFFFF, rounding())
    if not context.preferences.dark:
        draw.add_rect(corner, opposite, packed(context.palette.line), rounding())


def shade(corner: ImVec2, side: float, colour: Colour, opacity: float = 1.0) -> None:
    """Fill a square of ``side`` px, with round corners."""
    draw = imgui.get_window_draw_list()
    draw.add_rect_filled(corner, corner + ImVec2(side, side), packed(colour, opacity), rounding())


def tile_button(name: str, size: tuple[float, float] | ImVec2) -> bool:
    """Add an invisible button that the keyboard can focus; return True if pressed."""
    return imgui.invisible_button(as_label(name), size, imgui.ButtonFlags_.enable_nav)


def paint_photo(context: PanelContext, path: Path, corner: ImVec2, side: float) -> None:
    """Draw a photo file in a square of ``side`` px, empty until it is read."""
    paint_frame(context, context.session.photo_thumbnails.get(path), corner, side)


def outline(corner: ImVec2, side: float, colour: Colour, inset: float = 0.0) -> None:
    """Draw the border of a square, ``inset`` px inside."""
    low = corner + ImVec2(inset, inset)
    high = corner + ImVec2(side - inset, side - inset)
    imgui.get_window_draw_list().add_rect(low, high, packed(colour), rounding(), thickness=2.0)


def mark(corner: ImVec2, label: str, colour: Colour) -> None:
    """Draw a letter or an icon on a small coloured square."""
    draw = imgui.get_window_draw_list()
    em = hello_imgui.em_size()
    draw.add_rect_filled(corner, corner + ImVec2(MARK, MARK) * em, packed(colour), rounding())
    low = corner + ImVec2(MARK, MARK) * (em / 2) - imgui.calc_text_size(label) * 0.5
    draw.add_text(low, packed(on(colour)), label)


def dropped(context: PanelContext) -> str:
    """Return the object dropped on imgui's last item; "" for none.

    An object that cannot be mixed with the shown one is reported, not returned.
    """
    if not imgui.begin_drag_drop_target():
        return ""
    payload = imgui.accept_drag_drop_payload_py_id(DRAGGED)
    imgui.end_drag_drop_target()
    session = context.session
    name = context.dragged
    if payload and not session.editor.is_mixable(name):
        show = Button("Show", lambda: session.editor.show_object(name), name)
        instance = session.editor.scene.instance
        session.messages.notify(
            unmixable(context, name),
            MessageKind.NOTE,
            buttons=(show,),
            relevant=lambda: session.editor.scene.instance is instance,
        )
        return ""
    return name if payload else ""


def unmixable(context: PanelContext, name: str) -> str:
    """Return the message that an object cannot be mixed with the shown one."""
    editor = context.session.editor
    return (
        f"A {editor.objects[name].instance.model.noun} cannot be mixed with a {editor.model.noun}: "
        "show it to begin with it"
    )


def rounding() -> float:
    """Return the radius of corners in px."""
    return 0.3 * hello_imgui.em_size()
