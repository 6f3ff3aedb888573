"""Photos on their way to a code: compared with their render, and every step of the way to go back to."""

from functools import partial

from imgui_bundle import hello_imgui, icons_fontawesome_4, imgui

from core.fitting.confidence import DOUBTFUL, RIGHT_DEGREES
from viewer.activities.fitting import EFFORTS, Fitting
from viewer.context import IMAGES, Desk, button, flow, tip
from viewer.screen.file_dialog import Wish
from viewer.screen.theme import WARM
from viewer.widgets.comparison import Comparison
from viewer.widgets.fit_curve import Curve

_ICON, _CAMERA = icons_fontawesome_4.ICON_FA_IMAGE, icons_fontawesome_4.ICON_FA_CAMERA
_ADD, _PLACE = icons_fontawesome_4.ICON_FA_PLUS, icons_fontawesome_4.ICON_FA_CROSSHAIRS
_SCISSORS = icons_fontawesome_4.ICON_FA_CUT
_AGAIN = f"Fit again  {icons_fontawesome_4.ICON_FA_CARET_DOWN}"

_OTHER_HELP = """Try the other camera, which explains the photo next best; it is mostly on the other side.
Undo (Ctrl+Z) or the camera button brings you back."""
_EFFORT_HELP = """How much work the next fit is: draft less than half of normal, fine twice as much.
But in a draft, a camera in doubt is searched for twice."""
_ON_HELP = "Improve the fit from the step that is shown, for a third of the steps of a new one; it can go on again"
_VIEW_HELP = """Turn the object in the view to where the photo sees it, then go on from there:
for a camera that was not found"""
_CUT_HELP = "Point out the object in this photo, move it in its frame, and fit again"
_SURE = 0.9
"""Nearly all cameras of more confidence were right."""


class Fit:
    """Live while a fit runs; afterwards it shows how the last one went."""

    title = "Fit"
    dock = "Lower"

    def __init__(self) -> None:
        self._comparison = Comparison()
        self._curve = Curve()

    def draw(self, desk: Desk) -> None:
        """Buttons, the comparison, and the curve."""
        fitting = desk.session.fitting
        if fitting.running:
            _draw_progress(fitting)
        else:
            _draw_start(desk, fitting)
        if fitting.course.shot is None:
            imgui.spacing()
            what = f"Reading {fitting.course.name} …" if fitting.running else _invitation(desk)
            imgui.text_wrapped(what)
            return
        if not fitting.running:
            _draw_more(desk, fitting)
        _draw_views(fitting)
        self._comparison.draw_choice()
        _draw_told(fitting)
        self._comparison.draw(desk, imgui.get_content_region_avail().y - self._curve.height(fitting))
        self._curve.draw(desk)


def _draw_progress(fitting: Fitting) -> None:
    if button("Stop###stop fit", "End here and keep what has been found; you can go on later"):
        fitting.stop()
    imgui.same_line()
    course, last = fitting.course, fitting.course.last
    told = f"{last.psnr:.1f} dB    {last.seconds:.0f} s" if last else "Starting …"
    imgui.progress_bar(course.progress, (-1, 0), f"{told}    again, to be sure" if last and last.again else told)
    tip(f"{last.hypotheses} candidates in the race" if last else "Comparing the photo with what the model knows")


def _draw_start(desk: Desk, fitting: Fitting) -> None:
    """How to begin a fit."""
    ready, fitted = desk.session.ready, fitting.course.shot is not None
    if button(f"{_ICON}  Fit…###fit image", "Choose an image of one object, and find it", enabled=ready):
        desk.fit_image()
    imgui.same_line()
    imgui.set_next_item_width(hello_imgui.em_size(5))
    if imgui.begin_combo("##effort", fitting.effort):
        for effort in EFFORTS:
            if imgui.selectable(effort, effort == fitting.effort)[0]:
                fitting.effort = effort
        imgui.separator()
        fitting.lens = imgui.checkbox("any lens", fitting.lens)[1]
        tip("Search for the focal length too: for photos from nearer or further away than the model's pictures")
        imgui.end_combo()
    tip(_EFFORT_HELP)
    flow(_ADD)
    if button(f"{_ADD}###add photo", "Fit again with another photo of the same object beside this one", enabled=fitted):
        desk.files.ask(Wish("Another photo of the same object", partial(fitting.add, fitting.course), IMAGES))
    flow(_SCISSORS)
    if button(f"{_SCISSORS}###cut out", _CUT_HELP, enabled=fitted):
        fitting.cut_out()
    flow(_PLACE)
    if button(f"{_PLACE}###pose", "Fit again with the known camera of this photo (an SRN pose file)", enabled=fitted):
        desk.files.ask(Wish("Pose of this photo", partial(fitting.pose, fitting.course), (".txt",)))


def _draw_more(desk: Desk, fitting: Fitting) -> None:
    """What can be done with a fit that is over, be it that it was stopped before its first step."""
    flow(_CAMERA)
    told = "Jump to the camera that the photo was found to be taken from"
    if button(f"{_CAMERA}###photo camera", told, enabled=bool(fitting.course.steps)):
        desk.session.look(fitting.camera)
    _draw_trust(desk, fitting)
    if (other := fitting.alternative) is not None:
        flow("Other camera")
        if button("Other camera###other camera", _OTHER_HELP):
            desk.session.look(other)
    flow(_AGAIN)
    if button(f"{_AGAIN}###fit again", "Fit the same photo once more: ways to begin"):
        imgui.open_popup("again")
    if imgui.begin_popup("again"):
        _draw_ways(fitting)
        imgui.end_popup()
    _draw_spent(desk, fitting)


def _draw_spent(desk: Desk, fitting: Fitting) -> None:
    """What the fit took, in one line."""
    step = fitting.course.last
    if step is None or not any(step.directions):
        return
    shape, texture = (len(desk.session.space(part).spread) for part in ("shape", "texture"))
    parts = f"{step.directions[0]} of {shape} shape, {step.directions[1]} of {texture} texture directions"
    imgui.push_text_wrap_pos(0.0)
    imgui.text_disabled(f"{parts}, {step.step} steps")
    imgui.pop_text_wrap_pos()
    tip("Directions of the codes that were free to move: further ones are opened only where they lower the error")


def _draw_ways(fitting: Fitting) -> None:
    """Where to begin once more, with the work chosen above."""
    can = fitting.going_on is not None
    ways = (
        ("From the step shown###go on", _ON_HELP, fitting.go_on, can),
        ("From the view###from view", _VIEW_HELP, fitting.go_on_from_view, can),
        ("From the beginning###again", "The whole race again", fitting.again, True),
    )
    for label, told, act, enabled in ways:
        if imgui.menu_item_simple(label, enabled=enabled):
            act()
        tip(told)


def _draw_trust(desk: Desk, fitting: Fitting) -> None:
    """How sure the camera is."""
    step = fitting.course.step
    if step is None or step.confidence is None or step.spread is None:
        return
    words = in_words(step.confidence)
    told = f"Camera: {words}"
    flow(told)
    imgui.align_text_to_frame_padding()
    imgui.text_colored((*(WARM if words == "doubtful" else desk.palette.text), 1.0), told)
    tip(
        f"{step.confidence:.0%}: the probability that it is right to {RIGHT_DEGREES:.0f} degrees; if so, it is off by "
        f"about {step.spread:.1f}. A doubtful one may be seen from the object's other side"
    )


def _draw_told(fitting: Fitting) -> None:
    """At the end of the line of modes."""
    if (last := fitting.course.last) is not None and not fitting.running:
        told = f"{last.psnr:.1f} dB"
        imgui.same_line()
        left = imgui.get_content_region_avail().x - imgui.calc_text_size(told).x
        imgui.set_cursor_pos_x(imgui.get_cursor_pos_x() + max(0.0, left))
        imgui.text_disabled(told)
        tip(f"{fitting.course.name}, fitted in {last.seconds:.0f} s; on the way the curve estimates it from fewer rays")


def _draw_views(fitting: Fitting) -> None:
    """Which of several photos is looked at."""
    course = fitting.course
    if len(course.sources) < 2:
        return
    for number, source in enumerate(course.sources):
        if number:
            imgui.same_line()
        imgui.begin_disabled(number >= len(course.shots))
        if imgui.radio_button(f"{number + 1}###photo {number + 1}", course.view == number):
            fitting.turn_to(number)
        imgui.end_disabled()
        tip(source.path.name + (", its camera known" if source.pose else ""))


def in_words(confidence: float) -> str:
    """How far to trust a fitted camera (0..1)."""
    if confidence < DOUBTFUL:
        return "doubtful"
    return "sure" if confidence > _SURE else "likely"


def _invitation(desk: Desk) -> str:
    model = desk.session.model
    if model is None:
        return "Fitting comes with the model"
    what = model.category.removesuffix("s")
    return (
        f"Drop a photo of a {what} anywhere on this window, or several of the same one. It is cut out and framed, then "
        "its camera and its two codes are found. A plain ground helps; on any other you point it out."
    )
