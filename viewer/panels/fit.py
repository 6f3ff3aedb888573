"""A photo on its way to a code: compared with its render, and the loss."""

import numpy as np
from imgui_bundle import hello_imgui, icons_fontawesome_4, imgui, implot

from core.confidence import DOUBTFUL, RIGHT_DEGREES
from viewer.comparison import Comparison
from viewer.desk import Desk, button, tip
from viewer.fitting import Course, Fitting

_ICON, _CAMERA = icons_fontawesome_4.ICON_FA_IMAGE, icons_fontawesome_4.ICON_FA_CAMERA

_OTHER_HELP = """Look from the camera that explains the photo next best, mostly from the other side.
Undo (Ctrl+Z) or the camera button brings you back."""
_SURE = 0.9
"""Nearly all cameras of more confidence were right."""


class Fit:
    """Live while a fit runs; afterwards it shows how the last one went."""

    title = "Fit"
    dock = "Lower"

    def __init__(self) -> None:
        self._comparison = Comparison()

    def draw(self, desk: Desk) -> None:
        """Buttons, the comparison, and the curve."""
        fitting, course = desk.session.fitting, desk.session.fitting.course
        idle = desk.session.ready and not fitting.running
        if button(f"{_ICON}  Fit image…###fit image", "Choose an image of one object, and find it", enabled=idle):
            desk.fit_image()
        if fitting.running:
            imgui.same_line()
            if button("Stop###stop fit", "End here and keep what has been found"):
                fitting.stop()
        self._draw_progress(desk, fitting)
        if not fitting.running:
            self._draw_trust(desk, fitting)
        if course.photo is None:
            imgui.spacing()
            what = f"Reading {course.name} …" if fitting.running else _invitation(desk)
            imgui.text_wrapped(what)
            return
        self._comparison.draw(desk, imgui.get_content_region_avail().y - 6.5 * hello_imgui.em_size())
        self._draw_curve(course)

    def _draw_progress(self, desk: Desk, fitting: Fitting) -> None:
        course, last = fitting.course, fitting.course.last
        told = f"{last.psnr:.1f} dB    {last.seconds:.0f} s" if last else "Starting …"
        if fitting.running:
            imgui.same_line()
            imgui.progress_bar(course.progress, (-1, 0), told)
            tip(f"{last.hypotheses} cameras in the race" if last else "Comparing the photo with what the model knows")
        elif last:
            imgui.same_line()
            if button(f"{_CAMERA}###photo camera", "Jump to the camera that the photo was found to be taken from"):
                desk.session.look(fitting.camera)
            imgui.same_line()
            imgui.text_disabled(f"{course.name}    {told}")

    def _draw_trust(self, desk: Desk, fitting: Fitting) -> None:
        last, other = fitting.course.last, fitting.alternative
        if last is None or last.confidence is None or other is None:
            return
        if button("Try the other camera###other camera", _OTHER_HELP):
            desk.session.look(other)
        imgui.same_line()
        imgui.text_wrapped(f"Camera: {in_words(last.confidence)}")
        tip(f"{last.confidence:.0%}: the probability that it is right to {RIGHT_DEGREES:.0f} degrees")

    def _draw_curve(self, course: Course) -> None:
        height = max(4 * hello_imgui.em_size(), imgui.get_content_region_avail().y)
        flags = implot.Flags_.no_legend | implot.Flags_.no_menus | implot.Flags_.no_mouse_text
        if not implot.begin_plot("##loss", (-1, height), flags):
            return
        fit = implot.AxisFlags_.auto_fit
        implot.setup_axes("", "loss", fit, fit)
        implot.setup_axis_format(implot.ImAxis_.x1, "%g s")
        seconds = np.array([step.seconds for step in course.steps])
        losses = np.array([step.loss for step in course.steps])
        if len(seconds):
            implot.plot_line("loss", seconds, losses)
        implot.end_plot()


def in_words(confidence: float) -> str:
    """How far to trust a fitted camera (0..1)."""
    if confidence < DOUBTFUL:
        return "doubtful, it may be seen from the other side"
    return "sure" if confidence > _SURE else "likely"


def _invitation(desk: Desk) -> str:
    model = desk.session.model
    if model is None:
        return "Fitting comes with the model"
    what = model.category.removesuffix("s")
    return (
        f"Drop a photo of a {what} anywhere on this window. It is cut out and framed, then its camera and its two "
        "codes are found. A plain ground helps; a transparent one is best."
    )
