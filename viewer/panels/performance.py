"""How long the picture on screen took, and what it was drawn with."""

from imgui_bundle import imgui

from core.models.precision import linear_dtype
from core.rendering.progressive import Frame
from viewer.context import Desk, tip
from viewer.session import Session

_FLAGS = imgui.TableFlags_.sizing_fixed_fit | imgui.TableFlags_.row_bg


class SpeedPanel:
    """The stages of the picture on the left, the machine on the right."""

    title = "Speed"
    dock = "Strip"

    def draw(self, desk: Desk) -> None:
        """Two tables."""
        viewport = desk.session.viewport
        frame, times = viewport.frame, viewport.times
        if frame is None:
            imgui.text_disabled("The numbers come with the first picture")
            return
        if imgui.begin_table("stages", 4, _FLAGS, (imgui.get_content_region_avail().x * 0.55, 0)):
            for head in ("Stage", "Drawn", "Done after", "Rays a second"):
                imgui.table_setup_column(head)
            imgui.table_headers_row()
            started = 0.0
            for number, (size, seconds) in enumerate(times, 1):
                across = frame.across if frame.final and number == len(times) else 1
                rate = size[0] * size[1] * across**2 / max(seconds - started, 1e-6)
                started = seconds
                _row(str(number), f"{size[0]} x {size[1]} px", f"{1000 * seconds:.0f} ms", f"{rate:,.0f}")
            imgui.end_table()
        tip("Of the picture on screen; the first stage has what is needed for all of them, such as a new shape's cells")
        imgui.same_line()
        if imgui.begin_table("machine", 2, _FLAGS):
            for what, value in _told(desk.session, frame):
                _row(what, value)
            imgui.end_table()


def _told(session: Session, frame: Frame) -> list[tuple[str, str]]:
    assert session.model is not None, "no model yet"
    pace, device = session.viewport.pace, session.model.device
    asked = "" if frame.asked is None else f", {frame.asked.mean():.1f} evaluated"
    return [
        ("Samples a ray", f"{frame.samples}{asked}"),
        ("In motion", f"1/{pace.divisor} of the size, for {1000 * pace.budget:.0f} ms"),
        ("Number format", str(linear_dtype(device.type)).removeprefix("torch.")),
        ("Device", device.type if device.type == "cpu" else str(device)),
        ("Window", f"{imgui.get_io().framerate:.0f} frames a second"),
    ]


def _row(*cells: str) -> None:
    imgui.table_next_row()
    for cell in cells:
        imgui.table_next_column()
        imgui.text(cell)
