"""Photos and the codes fitted to them: compared with their render, at every step of the fit."""

from functools import partial

from imgui_bundle import icons_fontawesome_4, imgui

from core.fitting.confidence import RIGHT_DEGREES, in_words
from core.photos.decode import IMAGE_SUFFIXES
from viewer.activities.fit_stream import WINDOW_PRESETS
from viewer.activities.fitting import Fitting
from viewer.context import Panel, PanelContext
from viewer.screen.file_dialog import FileRequest
from viewer.widgets.comparison import Comparison
from viewer.widgets.controls import action_button, button, choose, end_gesture, flow, labelled_slider, tooltip
from viewer.widgets.fit_curve import FitCurve
from viewer.widgets.text import heading
from viewer.widgets.welcome import Samples

_ICON, _CAMERA = icons_fontawesome_4.ICON_FA_IMAGE, icons_fontawesome_4.ICON_FA_CAMERA
_ADD, _PLACE = icons_fontawesome_4.ICON_FA_PLUS, icons_fontawesome_4.ICON_FA_CROSSHAIRS
_SEGMENT = icons_fontawesome_4.ICON_FA_CUT
_REFIT = f"Rebuild  {icons_fontawesome_4.ICON_FA_CARET_DOWN}"

_RUNNER_UP_HELP = """Try the runner-up, the camera that explains the photo next best; it is mostly on the other side.
Undo (Ctrl+Z) or the camera button brings you back."""
_PRESET_HELP = """How much work the next search is: draft less than half of normal, fine twice as much.
Except in a draft, a camera in doubt is searched for once more."""
_RESUME_HELP = "Improve it from the step that is shown, for a third of the steps of a new search; can be repeated"
_VIEW_HELP = """Turn the object in the view to where the photo sees it, then continue from there:
for a camera that was not found"""
_SEGMENT_HELP = "Point out the object in this photo, move it in its frame, and rebuild it"
_DETAIL_HELP = """How much of the photo's own detail the object shows, such as lettering and lamps, in files too.
It fades as the object is edited. A doubtful camera shows none."""
_TALLEST = 1.0
"""height of the comparison, relative to the panel's width"""


class PhotoPanel(Panel):
    """Live while a fit runs; afterwards it shows how the last one went."""

    title = "Photo"
    dock = "Right"

    def __init__(self) -> None:
        self._comparison, self._samples = Comparison(), Samples()
        self._curve = FitCurve()

    def draw(self, context: PanelContext) -> None:
        """Buttons, the comparison, and what few look at: how the search goes, and how the next one is made."""
        fitting = context.fitting
        heading(context, "Rebuild from photo")
        if fitting.running:
            _draw_progress(fitting)
        else:
            _draw_start(context, fitting)
        if fitting.history.photo is None:
            imgui.spacing()
            what = f"Reading {fitting.history.sources[0].name} …" if fitting.running else _invitation(context)
            imgui.text_wrapped(what)
            if not fitting.running:
                self._samples.draw(context)
        else:
            if not fitting.running:
                _draw_more(context, fitting)
            _draw_photos(fitting)
            self._comparison.draw_choice()
            self._comparison.draw(context, _TALLEST * imgui.get_content_region_avail().x)
        _draw_strength(context)
        self._draw_details(context, fitting)

    def _draw_details(self, context: PanelContext, fitting: Fitting) -> None:
        if not imgui.collapsing_header("Details"):
            return
        _draw_preset(fitting)
        if button("Candidates###show candidates", "Which cameras and shapes are tried for the photo, the best first"):
            context.focus = "Candidates"
        if fitting.history.photo is not None:
            _draw_result(fitting)
            self._curve.draw(context)


def _draw_strength(context: PanelContext) -> None:
    """How much of the photo is on the object that is shown."""
    detail = context.editor.scene.codes.detail
    if detail is None:
        return
    shown = f"{detail.strength:.0%}"
    changed, strength = labelled_slider("photo detail", "Photo detail", detail.strength, (0.0, 1.0), shown, (6, 3))
    if changed:
        context.editor.set_detail_strength(strength, "photo detail")
    end_gesture(context)
    tooltip(_DETAIL_HELP)


def _draw_progress(fitting: Fitting) -> None:
    if button("Stop###stop fit", "End here and keep what has been found; you can resume later"):
        fitting.stop()
    imgui.same_line()
    history, last = fitting.history, fitting.history.last
    if last is None:
        label = "Starting …"
    else:
        label = "Checking from other sides" if last.restart else "Finding camera, shape and texture"
    imgui.progress_bar(history.progress, (-1, 0), "")
    if last:
        tooltip(f"{last.seconds:.0f} s, {last.psnr:.1f} dB, {last.active} candidates left")
    else:
        tooltip("Ranking the views of the view bank for the photo")
    imgui.text_wrapped(label)
    _draw_queue(fitting)


def _draw_queue(fitting: Fitting) -> None:
    """Which photos wait, and the object that can be used already."""
    if fitting.queue:
        imgui.align_text_to_frame_padding()
        imgui.text(f"{len(fitting.queue)} more wait{'s' if len(fitting.queue) == 1 else ''}")
        tooltip("\n".join(request.history.name for request in fitting.queue))
        imgui.same_line()
        if button("Clear###clear queue", "Forget the photos that wait"):
            fitting.clear_queue()
    if fitting.results.checking:
        imgui.text_disabled(f"{fitting.results.checking.name} can be used already")


def _draw_start(context: PanelContext, fitting: Fitting) -> None:
    """How to begin a fit."""
    fitted = fitting.history.photo is not None
    action_button(context, "fit_image", f"{_ICON}  Open photo…")
    flow(_ADD)
    if button(f"{_ADD}###add photo", "Rebuild with another photo of the same object beside this one", enabled=fitted):
        context.ask(
            FileRequest("Another photo of the same object", partial(fitting.add_photo, fitting.history), IMAGE_SUFFIXES)
        )
    flow(_SEGMENT)
    if button(f"{_SEGMENT}###segment", _SEGMENT_HELP, enabled=fitted):
        context.workspace.segment_photo()
    flow(_PLACE)
    if button(f"{_PLACE}###pose", "Rebuild with the known camera of this photo (an SRN pose file)", enabled=fitted):
        context.ask(FileRequest("Pose of this photo", partial(fitting.set_pose, fitting.history), (".txt",)))


def _draw_preset(fitting: Fitting) -> None:
    """How the next fit is made."""
    fitting.options.preset = choose(
        "preset", fitting.options.preset, {name: name for name in WINDOW_PRESETS}, _PRESET_HELP
    )
    flow("Estimate focal length        ")
    fitting.options.estimate_focal = imgui.checkbox("Estimate focal length", fitting.options.estimate_focal)[1]
    tooltip("For photos from nearer or further away than the model's training images")


def _draw_more(context: PanelContext, fitting: Fitting) -> None:
    """Buttons for a fit that is over, even if it was stopped before its first step."""
    flow(_CAMERA)
    label = "Jump to the camera that the photo was found to be taken from"
    if button(f"{_CAMERA}###photo camera", label, enabled=bool(fitting.history.steps)):
        context.editor.set_camera(fitting.view.camera)
    flow(_REFIT)
    if button(f"{_REFIT}###refit", "Rebuild from the same photo once more: ways to begin"):
        imgui.open_popup("refit")
    if imgui.begin_popup("refit"):
        _draw_ways(fitting)
        imgui.end_popup()
    _draw_confidence(context, fitting)
    other = fitting.view.other_camera
    flow("Try other viewpoint")
    if button("Try other viewpoint###other viewpoint", _RUNNER_UP_HELP, enabled=other is not None) and other:
        context.editor.set_camera(other)


def _draw_ways(fitting: Fitting) -> None:
    """Where to begin once more, with the work chosen above."""
    can = fitting.resume_point is not None
    ways = (
        ("From the step shown###resume", _RESUME_HELP, fitting.resume, can),
        ("From the view###resume from view", _VIEW_HELP, fitting.resume_from_view, can),
        ("From the beginning###restart", "The whole search once more", fitting.refit, True),
    )
    for label, text, act, enabled in ways:
        if imgui.menu_item_simple(label, enabled=enabled):
            act()
        tooltip(text)


def _draw_confidence(context: PanelContext, fitting: Fitting) -> None:
    """How sure the camera is; the line stays while a step without that is shown."""
    step = fitting.history.step
    if step is None or step.confidence is None or step.uncertainty is None:
        imgui.align_text_to_frame_padding()
        imgui.text_disabled("Camera: not rated")
        tooltip("Only the end of a search is")
        return
    words = in_words(step.confidence)
    label = f"Camera: {words}"
    imgui.align_text_to_frame_padding()
    imgui.text_colored((*(context.palette.warm if words == "doubtful" else context.palette.text), 1.0), label)
    tooltip(
        f"{step.confidence:.0%}: the probability that it is right to {RIGHT_DEGREES:.0f} degrees; if so, it is off by "
        f"about {step.uncertainty:.1f}. A doubtful one may be seen from the object's other side"
    )


def _draw_result(fitting: Fitting) -> None:
    """The time a fit took and how near it came, in one line."""
    if (last := fitting.history.last) is not None and not fitting.running:
        imgui.text_disabled(f"{last.step} steps    {last.seconds:.0f} s    {last.psnr:.1f} dB")
        tooltip(f"{fitting.history.name}; while it runs, the curve estimates the dB from fewer rays")


def _draw_photos(fitting: Fitting) -> None:
    """Which of several photos is shown."""
    history = fitting.history
    if len(history.sources) < 2:
        return
    for number, source in enumerate(history.sources):
        if number:
            imgui.same_line()
        imgui.begin_disabled(number >= len(history.photos))
        if imgui.radio_button(f"{number + 1}###photo {number + 1}", history.photo_index == number):
            fitting.view.show_photo(number)
        imgui.end_disabled()
        tooltip(source.name + (", its camera known" if source.pose else ""))


def _invitation(context: PanelContext) -> str:
    what = context.editor.model.noun
    return (
        f"Drop a photo of a {what} anywhere on this window, or several of the same one. It is cut out and cropped, "
        "then camera, shape and texture are found. A plain background helps; on any other you point it out."
    )
