"""How long the frame on screen took, and what it was rendered with."""

from collections.abc import Collection
from statistics import median

from imgui_bundle import hello_imgui, imgui

from core.rendering.progressive import Frame
from core.runtime.caches import CACHE
from core.runtime.precision import matmul_dtype
from viewer.context import Panel, PanelContext
from viewer.widgets.controls import tooltip

_FLAGS = imgui.TableFlags_.sizing_fixed_fit | imgui.TableFlags_.row_bg
_NARROW = 34  # em: less has no room for both tables side by side


class PerformancePanel(Panel):
    """The stages of the frame on the left, the machine on the right, or below where it is narrow."""

    title = "Performance"
    dock = "Drawer"
    folded = True

    def draw(self, context: PanelContext) -> None:
        """Two tables."""
        viewport = context.session.viewport
        frame, times = viewport.frame, viewport.times
        if frame is None:
            imgui.text_disabled("The numbers come with the first render")
            return
        room = imgui.get_content_region_avail().x
        wide = room > hello_imgui.em_size(_NARROW)
        if imgui.begin_table("stages", 4, _FLAGS, (0.55 * room if wide else 0.0, 0)):
            for head in ("Stage", "Rendered", "Done after", "Rays a second"):
                imgui.table_setup_column(head)
            imgui.table_headers_row()
            started = 0.0
            for number, (size, seconds) in enumerate(times, 1):
                rate = size[0] * size[1] / max(seconds - started, 1e-6)
                started = seconds
                _row(str(number), f"{size[0]} x {size[1]} px", f"{1000 * seconds:.0f} ms", f"{rate:,.0f}")
            imgui.end_table()
        tooltip(
            "Of the frame on screen; the first stage has what is needed for all of them, such as a new shape's cells"
        )
        if wide:
            imgui.same_line()
        if imgui.begin_table("machine", 2, _FLAGS):
            for what, value in _machine(context, frame):
                _row(what, value)
            imgui.end_table()


def _machine(context: PanelContext, frame: Frame) -> list[tuple[str, str]]:
    budget, device = context.session.viewport.budget, context.session.editor.model.device
    baked = context.session.viewport.baked if context.session.viewport.settings.baked else None
    evaluated = "" if frame.evaluations is None else f", {frame.evaluations.mean():.1f} evaluated"
    return [
        ("Samples a ray", f"{frame.samples}{evaluated}"),
        ("In motion", f"1/{budget.divisor} of the size, for {1000 * budget.limit:.0f} ms"),
        ("Turning", f"OpenGL, {baked.cells} cells a side" if baked else "rendered"),
        ("Number format", str(matmul_dtype(device.type)).removeprefix("torch.")),
        ("Kept", f"{CACHE.used / 2**20:.0f} of {CACHE.limit / 2**20:.0f} MB"),
        ("Device", device.type if device.type == "cpu" else str(device)),
        ("Window", f"{imgui.get_io().framerate:.0f} frames a second"),
        ("Window's own time", _own_time(context.frame_times)),
    ]


def _own_time(seconds: Collection[float]) -> str:
    """Median and longest processor time of the window's thread in the last frames: what it takes besides rendering."""
    return f"{1000 * median(seconds):.1f} ms a frame, longest of {len(seconds)} {1000 * max(seconds):.0f} ms"


def _row(*cells: str) -> None:
    imgui.table_next_row()
    for cell in cells:
        imgui.table_next_column()
        imgui.text(cell)
