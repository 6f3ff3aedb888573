"""The numbers of fits: the next fit's settings, and the last fit's result and curve."""

from collections.abc import Sequence

import numpy as np
from imgui_bundle import hello_imgui, imgui, implot

from core.fitting.fit import FitStep
from viewer.context import PanelContext
from viewer.widgets.controls import button, tooltip
from viewer.widgets.text import caption

_HEIGHT = 5.5  # em, of the curve
_FOCAL = "Find focal length"  # short enough for the panel at the largest text size


def draw_fit_numbers(context: PanelContext) -> None:
    """Draw settings, result and curve; call once a frame."""
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
    if not implot.begin_plot("##curve", (-1, _HEIGHT * hello_imgui.em_size()), flags.no_legend | flags.no_inputs):
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
