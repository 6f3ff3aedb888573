"""Shape and texture along the principal directions of the trained codes, separately."""

from imgui_bundle import hello_imgui, icons_fontawesome_4, imgui

from viewer.desk import Desk, button, tip
from viewer.session import PARTS, Part

_DICE = icons_fontawesome_4.ICON_FA_RANDOM
_FIRST = 8
"""sliders shown at first"""
_REACH = 3.0
"""standard deviations to either side"""
_HELP = (
    "Direction {number}, {share:.0%} of how the trained objects differ in {part}.\n"
    "In standard deviations; 0 is the mean. Ctrl+click to type, right click for 0."
)


class CodesPanel:
    """Two columns of sliders. A slider changes its coordinate and nothing else."""

    title = "Codes"
    dock = "Lower"

    def __init__(self) -> None:
        self._all = False

    def draw(self, desk: Desk) -> None:
        """Both kinds side by side."""
        if not desk.session.ready:
            imgui.text_disabled("The sliders come with the model")
            return
        if imgui.begin_table("kinds", 2, imgui.TableFlags_.sizing_stretch_same):
            for part in PARTS:
                imgui.table_next_column()
                self._draw_part(desk, part)
            imgui.end_table()
        most = max(len(desk.session.space(part).spread) for part in PARTS)
        if most > _FIRST:
            _, self._all = imgui.checkbox(f"All {most} directions###all", self._all)

    def _draw_part(self, desk: Desk, part: Part) -> None:
        session = desk.session
        imgui.begin_disabled(part in session.locked)
        imgui.align_text_to_frame_padding()
        imgui.text(part.capitalize())
        imgui.same_line()
        if button(f"{_DICE}###Random {part}", f"Random: a {part} drawn from the cloud of the trained ones"):
            session.randomise(part)
        if button(f"Mean##{part}", f"The mean {part} of the trained objects"):
            session.to_mean(part)
        imgui.same_line(0, hello_imgui.em_size(0.3))
        if button(f"Reset##{part}", f"The {part} of object A"):
            session.to_object(part)
        space = session.space(part)
        values = space.coordinates(session.code(part)).tolist()
        for index, value in enumerate(values if self._all else values[:_FIRST]):
            self._draw_slider(desk, part, index, value, float(space.explained[index]))
        imgui.end_disabled()

    def _draw_slider(self, desk: Desk, part: Part, index: int, value: float, share: float) -> None:
        session = desk.session
        imgui.set_next_item_width(-1)
        moved, to = imgui.slider_float(f"##{part} {index + 1}", value, -_REACH, _REACH, f"{index + 1}:  %+.2f")
        if moved and abs(to - value) > 1e-6:
            session.move_along(part, index, to, gesture=f"{part} {index}")
        if imgui.is_item_deactivated():
            session.settle()
        if imgui.is_item_clicked(imgui.MouseButton_.right):
            session.move_along(part, index, 0.0)
        tip(_HELP.format(number=index + 1, share=share, part=part))
