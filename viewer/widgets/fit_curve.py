"""Loss and PSNR of a fit against its seconds; drag along them to see any step."""

import numpy as np
from imgui_bundle import ImVec2, hello_imgui, icons_fontawesome_4, imgui, implot

from viewer.activities.fitting import Fitting
from viewer.context import PanelContext
from viewer.screen.theme import WARM, packed
from viewer.widgets.controls import button, end_gesture, tooltip

_SCRUB_HELP = "Drag to see any step of the search, here and in the view; undo brings you back"
_HEIGHT = 5.5  # em


class FitCurve:
    """Loss and PSNR, below the comparison."""

    def draw(self, context: PanelContext) -> None:
        """The plot, and where it was dragged the step that is shown."""
        fitting = context.session.fitting
        if fitting.history.steps:
            self._draw_plot(context, fitting, _HEIGHT * hello_imgui.em_size())
            _draw_step(fitting)

    def _draw_plot(self, context: PanelContext, fitting: Fitting, height: float) -> None:
        steps = fitting.history.steps
        seconds = np.array([step.seconds for step in steps])
        # Scrubbing is not panning: the plot takes no input of its own.
        flags = implot.Flags_.no_legend | implot.Flags_.no_menus | implot.Flags_.no_mouse_text | implot.Flags_.no_inputs
        if not implot.begin_plot("##curve", (-1, height), flags):
            return
        fit = implot.AxisFlags_.auto_fit
        second = fit | implot.AxisFlags_.aux_default
        implot.setup_axes("", "loss", fit, fit | implot.AxisFlags_.no_tick_marks)
        implot.setup_axis(implot.ImAxis_.y2, "dB", second)
        implot.setup_axis_format(implot.ImAxis_.x1, "%g s")
        implot.setup_axis_scale(implot.ImAxis_.y1, implot.Scale_.log10)
        accent, warm = (imgui.ImVec4(*colour, 1.0) for colour in (context.palette.accent, WARM))
        implot.plot_line("loss", seconds, np.array([step.loss for step in steps]), spec=implot.Spec(line_color=accent))
        implot.set_axes(implot.ImAxis_.x1, implot.ImAxis_.y2)
        implot.plot_line("PSNR", seconds, np.array([step.psnr for step in steps]), spec=implot.Spec(line_color=warm))
        corner, size, limits = implot.get_plot_pos(), implot.get_plot_size(), implot.get_plot_limits().x
        implot.end_plot()
        self._scrub(context, fitting, seconds, (corner, size), (limits.min, limits.max))

    def _scrub(
        self,
        context: PanelContext,
        fitting: Fitting,
        seconds: np.ndarray,
        box: tuple[ImVec2, ImVec2],
        limits: tuple[float, float],
    ) -> None:
        (corner, size), (least, most) = box, limits
        after = imgui.get_cursor_screen_pos()
        imgui.set_cursor_screen_pos(corner)
        imgui.invisible_button("scrub", size)
        across = (imgui.get_mouse_pos().x - corner.x) / max(1.0, size.x)
        nearest = int(np.abs(seconds - (least + across * (most - least))).argmin())
        if imgui.is_item_active():
            if nearest != fitting.history.selected:
                fitting.view.scrub(nearest, gesture="scrub")
        else:
            tooltip(_SCRUB_HELP)
        end_gesture(context)
        imgui.set_cursor_screen_pos(after)
        imgui.dummy((0, 0))
        if (at := fitting.history.selected) is not None:
            x = corner.x + size.x * (seconds[at] - least) / max(1e-9, most - least)
            imgui.get_window_draw_list().add_line(
                (x, corner.y), (x, corner.y + size.y), packed(context.palette.text), 2.0
            )


def _draw_step(fitting: Fitting) -> None:
    """Which step is shown, and what to do with it; disabled at the newest one."""
    history, step = fitting.history, fitting.history.step
    newest = history.selected is None
    icon = icons_fontawesome_4.ICON_FA_FAST_FORWARD
    if button(f"{icon}  Newest###newest", "Back to the newest step", enabled=not newest):
        fitting.view.scrub(None)
    imgui.same_line()
    if button("Keep###keep step", "Add this step to the objects", enabled=not newest):
        fitting.keep()
    imgui.same_line()
    if step:
        number = len(history.steps) if history.selected is None else history.selected + 1
        imgui.text(f"Step {number} of {len(history.steps)}    {step.seconds:.1f} s    {step.psnr:.1f} dB")
