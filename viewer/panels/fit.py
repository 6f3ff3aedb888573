"""A photo on its way to a code: the photo, the current render, and the loss."""

import numpy as np
from imgui_bundle import ImVec2, hello_imgui, icons_fontawesome_4, imgui, implot

from viewer.desk import Desk, button, tip
from viewer.fitting import Fitting
from viewer.theme import packed

_ICON = icons_fontawesome_4.ICON_FA_IMAGE


class Fit:
    """Live while a fit runs; afterwards it shows how the last one went."""

    title = "Fit"
    dock = "Lower"

    def draw(self, desk: Desk) -> None:
        """Buttons, the two pictures, and the curve."""
        fitting = desk.session.fitting
        idle = desk.session.ready and not fitting.running
        if button(f"{_ICON}  Fit image…###fit image", "Choose an image of one object, and find it", enabled=idle):
            desk.fit_image()
        if fitting.running:
            imgui.same_line()
            if button("Stop###stop fit", "End here and keep what has been found"):
                fitting.stop()
        self._draw_progress(fitting)
        if fitting.photo is None:
            imgui.spacing()
            what = f"Reading {fitting.name} …" if fitting.running else _invitation(desk)
            imgui.text_wrapped(what)
            return
        self._draw_pictures(desk, fitting)
        self._draw_curve(fitting)

    def _draw_progress(self, fitting: Fitting) -> None:
        last = fitting.steps[-1] if fitting.steps else None
        told = f"{last.psnr:.1f} dB    {last.seconds:.0f} s" if last else "Starting …"
        if fitting.running:
            imgui.same_line()
            imgui.progress_bar(fitting.progress, (-1, 0), told)
            tip(f"{last.hypotheses} cameras in the race" if last else "Comparing the photo with what the model knows")
        elif last:
            imgui.same_line()
            imgui.text_disabled(f"{fitting.name}    {told}")

    def _draw_pictures(self, desk: Desk, fitting: Fitting) -> None:
        gap, em = imgui.get_style().item_spacing.x, hello_imgui.em_size()
        room = imgui.get_content_region_avail()
        side = max(3 * em, min((room.x - gap) / 2, room.y - 9 * em))
        corner = imgui.get_cursor_screen_pos() + ImVec2((room.x - gap) / 2 - side, 0)
        _draw_picture(desk, "Photo", fitting.pixels, corner, side)
        _draw_picture(desk, "Render", fitting.shown, corner + ImVec2(side + gap, 0), side)
        imgui.dummy((room.x, side))

    def _draw_curve(self, fitting: Fitting) -> None:
        height = max(5 * hello_imgui.em_size(), imgui.get_content_region_avail().y)
        flags = implot.Flags_.no_legend | implot.Flags_.no_menus | implot.Flags_.no_mouse_text
        if not implot.begin_plot("##loss", (-1, height), flags):
            return
        fit = implot.AxisFlags_.auto_fit
        implot.setup_axes("", "loss", fit, fit)
        implot.setup_axis_format(implot.ImAxis_.x1, "%g s")
        seconds = np.array([step.seconds for step in fitting.steps])
        losses = np.array([step.loss for step in fitting.steps])
        if len(seconds):
            implot.plot_line("loss", seconds, losses)
        implot.end_plot()


def _draw_picture(desk: Desk, caption: str, pixels: np.ndarray | None, corner: ImVec2, side: float) -> None:
    draw, em = imgui.get_window_draw_list(), hello_imgui.em_size()
    opposite = corner + ImVec2(side, side)
    draw.add_rect_filled(corner, opposite, packed((1, 1, 1)), 0.3 * em)
    if pixels is not None and desk.images is not None:
        texture = desk.images.texture(pixels, desk.palette)
        draw.add_image_rounded(texture, corner, opposite, (0, 0), (1, 1), packed((1, 1, 1)), 0.3 * em)
    draw.add_text(corner + ImVec2(0.5, 0.3) * em, packed((0.38, 0.38, 0.38)), caption)


def _invitation(desk: Desk) -> str:
    model = desk.session.model
    if model is None:
        return "Fitting comes with the model"
    what = model.category.removesuffix("s")
    return (
        f"Drop a photo of a {what} anywhere on this window. It is cut out and framed, then its camera and its two "
        "codes are found. A plain ground helps; a transparent one is best."
    )
