"""The panel for developers: all view modes, speed, candidates of a fit, and all messages."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from imgui_bundle import hello_imgui, imgui, implot

from core.detail.progressive import Frame
from core.fitting.fit import FitStep
from core.fitting.hypotheses import Hypothesis
from core.runtime.caches import CACHE
from core.runtime.precision import matmul_dtype
from viewer.context import Panel, PanelContext
from viewer.services.messages import MessageKind
from viewer.values.view_modes import MODES
from viewer.widgets import object_tiles
from viewer.widgets.controls import button, choose, flow, tooltip
from viewer.widgets.text import caption

_TILE = 3.4  # em, side of a candidate
_EVERY = 8  # steps of a fit for which its candidates stay, so that all are rendered
_SIZE, _CLOSER = 32, 1.5  # px of a candidate's image, and its zoom: photos have a margin around the object
_CURVE = 5.5  # em, height of the curve of a fit
_FOCAL = "Find focal length"  # short enough for the panel at the largest text size
_FLAGS = imgui.TableFlags_.sizing_stretch_prop | imgui.TableFlags_.row_bg


class DeveloperPanel(Panel):
    """View mode, above sections that can be folded."""

    title = "Developer"
    dock = "Right"
    folded = True

    def draw(self, context: PanelContext) -> None:
        """Draw the view mode above the sections."""
        viewport = context.session.viewport
        modes = {mode: mode.capitalize() for mode in MODES}
        viewport.change(mode=choose("mode", viewport.settings.mode, modes, "What the view shows"))
        sections = {
            "Performance": _draw_speed,
            "Fit": _draw_fit,
            "Candidates": _draw_candidates,
            "Messages": _draw_messages,
        }
        for title, draw in sections.items():
            if imgui.collapsing_header(title, imgui.TreeNodeFlags_.default_open):
                draw(context)


def _draw_speed(context: PanelContext) -> None:
    """Draw the time of the image on screen, and settings of the machine."""
    frame = context.session.viewport.frame
    if frame and imgui.begin_table("machine", 2, _FLAGS):
        for row in _machine(context, frame):
            imgui.table_next_row()
            for cell in row:
                imgui.table_next_column()
                imgui.text_wrapped(cell)
        imgui.end_table()


def _machine(context: PanelContext, frame: Frame) -> list[tuple[str, str]]:
    budget = context.session.viewport.budget
    device = context.session.editor.model.device
    baked = context.session.viewport.baked if context.session.viewport.settings.baked else None
    evaluated = "" if frame.evaluations is None else f", {frame.evaluations.mean():.1f} evaluated"
    width, height = frame.resolution
    return [
        ("Image", f"{width} x {height} px in {1000 * frame.seconds:.0f} ms"),
        ("Samples a ray", f"{frame.samples}{evaluated}"),
        ("In motion", f"1/{budget.divisor} of the size, {budget.rate:,.0f} rays a second"),
        ("Turning", f"OpenGL, {baked.cells} cells a side" if baked else "rendered"),
        ("Number format", str(matmul_dtype(device.type)).removeprefix("torch.")),
        ("Kept", f"{CACHE.used / 2**20:.0f} of {CACHE.limit / 2**20:.0f} MB"),
        ("Device", device.type if device.type == "cpu" else str(device)),
        ("Window", f"{imgui.get_io().framerate:.0f} frames a second"),
    ]


def _draw_fit(context: PanelContext) -> None:
    """Draw the next fit's settings, and the last fit's result and curve."""
    fitting = context.session.fitting
    fitting.options.estimate_focal = imgui.checkbox(_FOCAL, fitting.options.estimate_focal)[1]
    tooltip("Estimate it: for photos from nearer or further away than the model's training images")
    if (last := fitting.history.last) is not None and not fitting.running:
        sure = "" if last.confidence is None else f"    camera {last.confidence:.0%}"
        caption(context, f"{last.step} steps    {last.seconds:.0f} s    {last.psnr:.1f} dB{sure}")
        can_resume = fitting.history.resume_point is not None
        if button("Go on###resume", "Improve it for a third of the steps of a new search", enabled=can_resume):
            fitting.resume()
    if fitting.history.steps:
        _draw_curve(context, fitting.history.steps)


def _draw_curve(context: PanelContext, steps: Sequence[FitStep]) -> None:
    """Draw loss and PSNR against seconds."""
    flags = implot.Flags_
    if not implot.begin_plot("##curve", (-1, _CURVE * hello_imgui.em_size()), flags.no_legend | flags.no_inputs):
        return
    fit = implot.AxisFlags_.auto_fit
    implot.setup_axes("", "loss", fit, fit | implot.AxisFlags_.no_tick_marks)
    implot.setup_axis(implot.ImAxis_.y2, "dB", fit | implot.AxisFlags_.aux_default)
    implot.setup_axis_format(implot.ImAxis_.x1, "%g s")
    implot.setup_axis_scale(implot.ImAxis_.y1, implot.Scale_.log10)
    accent, warm = (imgui.ImVec4(*colour, 1.0) for colour in (context.palette.accent, context.palette.warm))
    seconds, loss, psnr = np.array([(step.seconds, step.loss, step.psnr) for step in steps]).T.copy()
    implot.plot_line("loss", seconds, loss, spec=implot.Spec(line_color=accent))
    implot.set_axes(implot.ImAxis_.x1, implot.ImAxis_.y2)
    implot.plot_line("PSNR", seconds, psnr, spec=implot.Spec(line_color=warm))
    implot.end_plot()


def _draw_candidates(context: PanelContext) -> None:
    """Draw the hypotheses of a fit, the best first; a click prefers one to all others."""
    fitting = context.session.fitting
    side = _TILE * hello_imgui.em_size()
    steps = fitting.history.steps
    if not steps:
        caption(context, "While a photo is fitted: the cameras and shapes that are tried for it, the best first")
        return
    newest = (len(steps) - 1) // _EVERY * _EVERY if fitting.running else -1
    for rank, hypothesis in enumerate(steps[newest].hypotheses):
        if rank:
            flow("candidate", _TILE)
        _draw_candidate(context, hypothesis, rank, side)


def _draw_candidate(context: PanelContext, hypothesis: Hypothesis, rank: int, side: float) -> None:
    fitting = context.session.fitting
    corner = imgui.get_cursor_screen_pos()
    preferable = fitting.history.can_resume(hypothesis)
    if object_tiles.tile_button(f"candidate {rank + 1}", (side, side)) and preferable:
        fitting.resume(hypothesis)
    tooltip(_label(hypothesis, rank, preferable))
    camera = hypothesis.cameras[0].resized(_SIZE, _SIZE)
    frame = context.session.thumbnails.get(hypothesis.instance, replace(camera, focal=_CLOSER * camera.focal))
    object_tiles.paint_frame(context, frame, corner, side)
    if rank == 0:
        object_tiles.outline(corner, side, context.palette.accent)


def _label(hypothesis: Hypothesis, rank: int, preferable: bool) -> str:
    camera = hypothesis.cameras[0]
    words = f"azimuth {math.degrees(camera.azimuth):.0f}, elevation {math.degrees(camera.elevation):.0f} degrees"
    words += f"\ndistance {camera.distance:.2f}, focal length {camera.focal / camera.height:.2f} of the image's height"
    prefer = "\nClick to prefer it: the search continues from here alone" if preferable else ""
    return f"Rank {rank + 1}, loss {hypothesis.loss:.4f}\n{words}{prefer}"


def _draw_messages(context: PanelContext) -> None:
    """Draw the log of messages, the newest first, with details of unexpected errors."""
    for message in reversed(context.session.messages.log):
        colour = context.palette.error if message.kind is MessageKind.PROBLEM else context.palette.text
        imgui.push_style_color(imgui.Col_.text, (*colour, 1.0))
        imgui.text_wrapped(f"{message.written:%H:%M:%S}  {message.text}")
        imgui.pop_style_color()
        if message.detail:
            caption(context, message.detail)
