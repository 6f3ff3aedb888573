"""How far shape and texture are from what the model was trained on, and a way back."""

from imgui_bundle import ImVec2, hello_imgui, imgui

from viewer.context import Desk, flow, tip
from viewer.screen.theme import Colour
from viewer.session import PARTS, Part
from viewer.widgets import object_tiles as faces

_REACH = 3.0
"""standard deviations, where the slider ends"""
_LEAST = 0.01
"""standard deviations, where it begins: the mean itself has no direction to lead out again"""
_USUAL, _ODD = 1.4, 1.8
"""standard deviations: trained objects are nearer; farther out there is rarely a sound object"""
_GREEN: Colour = (0.35, 0.75, 0.5)
_AMBER: Colour = (0.9, 0.66, 0.25)
_HELP = (
    "From the mean of the trained {part}s, in standard deviations; a trained one has about 1.\n"
    "Drag to the left to pull the {part} back towards the mean."
)


class Plausibility:
    """For each code a meter, which is the slider that pulls it back, and the trained object that is nearest."""

    title = "Plausible"
    dock = "Lower"

    def draw(self, desk: Desk) -> None:
        """Both kinds side by side."""
        if not desk.session.ready:
            imgui.text_disabled("The meters come with the model")
            return
        if imgui.begin_table("kinds", 2, imgui.TableFlags_.sizing_stretch_same):
            for part in PARTS:
                imgui.table_next_column()
                imgui.begin_disabled(part in desk.session.locked)
                self._draw_meter(desk, part)
                imgui.end_disabled()
                self._draw_nearest(desk, part)
            imgui.end_table()

    def _draw_meter(self, desk: Desk, part: Part) -> None:
        session, distance = desk.session, desk.session.distance(part)
        far, colour = _verdict(desk, distance)
        imgui.text(part.capitalize())
        flow(far)
        imgui.text_colored((*colour, 1.0), far)
        imgui.set_next_item_width(-1)
        imgui.push_style_color(imgui.Col_.slider_grab, (*colour, 1.0))
        moved, to = imgui.slider_float(f"##pull {part}", distance, _LEAST, _REACH, "%.2f SD")
        imgui.pop_style_color()
        if moved and abs(to - distance) > 1e-4:
            session.pull(part, max(_LEAST, to), gesture=f"pull {part}")
        if imgui.is_item_deactivated():
            session.settle()
        tip(_HELP.format(part=part))

    def _draw_nearest(self, desk: Desk, part: Part) -> None:
        nearest = desk.session.nearest(part)
        if nearest is None:
            return
        name, distance = nearest
        corner = imgui.get_cursor_screen_pos()
        side = min(5 * hello_imgui.em_size(), 0.4 * imgui.get_content_region_avail().x)
        imgui.dummy(ImVec2(side, side))
        faces.paint(desk, name, corner, side)
        imgui.same_line()
        imgui.begin_group()
        imgui.text_disabled("Nearest")
        imgui.text_wrapped(name)
        imgui.text_disabled(f"{distance:.2f} SD away")
        imgui.end_group()


def _verdict(desk: Desk, distance: float) -> tuple[str, Colour]:
    if distance <= _USUAL:
        return "as the trained ones", _GREEN
    return ("unusual", _AMBER) if distance <= _ODD else ("far out", desk.palette.error)
