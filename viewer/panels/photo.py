"""Photos and the codes fitted to them: compared with their render, at every step of the fit."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from imgui_bundle import ImVec2, hello_imgui, icons_fontawesome_4, imgui

from core.fitting.confidence import RIGHT_DEGREES, explained, in_words
from core.models.codes import Codes
from core.models.photo_detail import PhotoDetail
from core.photos.decode import IMAGE_SUFFIXES
from viewer.activities.fit_stream import WINDOW_PRESETS
from viewer.activities.fitting import Fitting
from viewer.context import Panel, PanelContext
from viewer.screen.file_dialog import FileRequest
from viewer.screen.theme import packed
from viewer.values.photo_sources import describe_sources, side_cameras
from viewer.widgets import user_objects
from viewer.widgets.comparison import Comparison
from viewer.widgets.controls import action_button, button, choose, end_gesture, flow, labelled_slider, tooltip
from viewer.widgets.eraser import Eraser
from viewer.widgets.fit_curve import FitCurve
from viewer.widgets.text import heading
from viewer.widgets.welcome import draw_samples, nouns

_ICON, _SHARE = icons_fontawesome_4.ICON_FA_IMAGE, icons_fontawesome_4.ICON_FA_SHARE_ALT
_REFIT = f"Rebuild  {icons_fontawesome_4.ICON_FA_CARET_DOWN}"

_VIEWPOINT_HELP = """The second is the runner-up, the camera that explains the photo next best, mostly from behind.
A click shows the object, and its render, from there."""
_PRESET_HELP = """How much work the next search is: draft less than half of normal, fine twice as much.
Except in a draft, a camera in doubt is searched for once more."""
_RESUME_HELP = "Improve it from the step that is shown, for a third of the steps of a new search; can be repeated"
_VIEW_HELP = """Turn the object in the view to where the photo sees it, then continue from there:
for a camera that was not found"""
_AS_HELP = "Whatever the photo seems to show"
_SEGMENT_HELP = "Point out the object in this photo, move it in its frame, and rebuild it"
_DETAIL_HELP = """How much of the photo's own detail the object shows, such as its outline and lettering, in files too.
It fades as the object is edited. A doubtful camera shows none."""
_BOTH_SIDES_HELP = """What the photo does not see takes the mirror image of what it sees, as sharp as that.
 Else softly, as light is not symmetric. Lettering is mirrored, too."""
_AGREE = 0.5  # of how far renders explain their photos
_BELOW = 8  # lines of controls below the comparison


class PhotoPanel(Panel):
    """Live while a fit runs; afterwards it shows how the last one went."""

    title = "Photo"
    dock = "Right"

    def __init__(self) -> None:
        self._comparison, self._curve, self._eraser = Comparison(), FitCurve(), Eraser()
        self._erasing = False  # the photo is shown to be erased from

    def draw(self, context: PanelContext) -> None:
        """Buttons, the comparison, and what few look at: how the search goes, and how the next one is made."""
        fitting = context.session.fitting
        photo = fitting.history.photo
        heading(context, f"Rebuilt from {photo.source.name}" if photo and not fitting.running else "Rebuild from photo")
        if fitting.running:
            _draw_progress(fitting)
        else:
            _draw_start(context, fitting)
        if fitting.history.photo is None:
            imgui.spacing()
            what = f"Reading {fitting.history.sources[0].name} …" if fitting.running else _invitation(context)
            imgui.text_wrapped(what)
            if not fitting.running:
                draw_samples(context)
        else:
            if not fitting.running:
                _draw_verdict(context, fitting)
            _draw_photos(fitting)
            self._comparison.draw_choice()
            below = _BELOW * imgui.get_frame_height_with_spacing()
            self._comparison.draw(context, imgui.get_content_region_avail().y - below)
            if fitting.history.last and not fitting.running:
                _draw_next(context)
        self._draw_photo_detail(context)
        self._draw_details(context, fitting)

    def _draw_photo_detail(self, context: PanelContext) -> None:
        """How much of the photo is on the object that is shown, and which of it."""
        codes = context.session.editor.scene.codes
        if (detail := codes.detail) is None:
            return
        _draw_strength(context, detail)
        changed, both = imgui.checkbox("Copy to the other side###both sides", detail.other_side == "mirrored")
        tooltip(_BOTH_SIDES_HELP)
        if changed:
            context.session.editor.set_detail(replace(detail, other_side="mirrored" if both else "soft"))
        flow("Erase…     ")
        self._erasing = imgui.checkbox("Erase…###erase detail", self._erasing)[1]
        tooltip("Wipe away what does not belong to the object, such as a reflection")
        if self._erasing:
            number = min(context.session.fitting.history.photo_index, len(detail.views) - 1)
            self._eraser.draw(context, number, 0.7 * imgui.get_content_region_avail().x)
            if button("Bring back###restore detail", "All that was erased", enabled=bool(detail.views[number].erased)):
                context.session.editor.set_detail(detail.erasing(number, ()))
        _draw_sources(context, codes)

    def _draw_details(self, context: PanelContext, fitting: Fitting) -> None:
        if not imgui.tree_node_ex("Details", imgui.TreeNodeFlags_.no_tree_push_on_open):
            return
        _draw_preset(fitting)
        if button("Candidates###show candidates", "Which cameras and shapes are tried for the photo, the best first"):
            context.focus = "Developer"
        if fitting.history.photo is not None:
            _draw_result(fitting)
            self._curve.draw(context)


def _draw_strength(context: PanelContext, detail: PhotoDetail) -> None:
    shown = f"{detail.strength:.0%}"
    changed, strength = labelled_slider("photo detail", "Photo detail", detail.strength, (0.0, 1.0), shown, (6, 3))
    if changed:
        context.session.editor.set_detail_strength(strength, "photo detail")
    end_gesture(context)
    tooltip(_DETAIL_HELP)


def _draw_sources(context: PanelContext, codes: Codes) -> None:
    """Which sides are from the photo, once they have been rendered small."""
    model = context.session.editor.model
    views = {side: context.session.thumbnails.get(codes, camera) for side, camera in side_cameras(model).items()}
    frames = {side: frame for side, frame in views.items() if frame}
    imgui.text_wrapped(describe_sources(model, frames) if len(frames) == len(views) else "…")
    tooltip("The view mode Source tints it: green is from the photo, blue from its mirror image, grey the model's")


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
    if fitting.results.checking:
        imgui.text_disabled(f"{fitting.results.checking.name} can be used already")


def _draw_start(context: PanelContext, fitting: Fitting) -> None:
    """How to begin a fit, or the same one once more."""
    action_button(context, "fit_image", f"{_ICON}  Open photo…")
    flow(_REFIT)
    fitted = fitting.history.photo is not None
    if button(f"{_REFIT}###refit", "Rebuild the same object once more: ways to begin", enabled=fitted):
        imgui.open_popup("refit")
    if imgui.begin_popup("refit"):
        _draw_ways(context, fitting)
        imgui.end_popup()


def _draw_next(context: PanelContext) -> None:
    """What a person does next."""
    if button("Mix with…###mix with", "Give it the shape or the texture of another object"):
        context.focus = "Mix"
    flow(f"{_SHARE}  Share…")
    action_button(context, "share", f"{_SHARE}  Share…", colour=context.palette.accent)


def _draw_preset(fitting: Fitting) -> None:
    """How the next fit is made."""
    fitting.options.preset = choose(
        "preset", fitting.options.preset, {name: name for name in WINDOW_PRESETS}, _PRESET_HELP
    )
    flow("Estimate focal length        ")
    fitting.options.estimate_focal = imgui.checkbox("Estimate focal length", fitting.options.estimate_focal)[1]
    tooltip("For photos from nearer or further away than the model's training images")


def _draw_verdict(context: PanelContext, fitting: Fitting) -> None:
    """How sure the camera is, and which viewpoint is shown; there even if a fit was stopped before its first step."""
    _draw_confidence(context, fitting)
    step = fitting.history.step
    flow("Viewpoint" + 20 * " ")
    imgui.align_text_to_frame_padding()
    imgui.text("Viewpoint")
    for number, there in ((1, step is not None), (2, bool(step and step.runner_up))):
        imgui.same_line()
        imgui.begin_disabled(not there)
        if imgui.radio_button(f"{number}###viewpoint {number}", fitting.view.from_runner_up == (number == 2)):
            fitting.view.show_viewpoint(number == 2)
        imgui.end_disabled()
        tooltip(_VIEWPOINT_HELP)


def _draw_ways(context: PanelContext, fitting: Fitting) -> None:
    """Where to begin once more, with the work chosen below, or with what else is known."""
    can, history = fitting.resume_point is not None, fitting.history
    more = FileRequest("Another photo of the same object", partial(fitting.add_photo, history), IMAGE_SUFFIXES)
    pose = FileRequest("Pose of this photo", partial(fitting.set_pose, history), (".txt",))
    ways: list[tuple[str, str, Callable[[], None], bool]] = [
        ("From the step shown###resume", _RESUME_HELP, fitting.resume, can),
        ("From the view###resume from view", _VIEW_HELP, fitting.resume_from_view, can),
        ("From the beginning###restart", "The whole search once more", fitting.refit, True),
        ("Cut out again…###segment", _SEGMENT_HELP, context.session.segment_photo, True),
        ("With another photo…###add photo", "One of the same object", lambda: context.files.ask(more), True),
        ("With its camera…###pose", "Where that is known: an SRN pose file", lambda: context.files.ask(pose), True),
    ]
    ways += [
        (f"As a {model.noun}###as {model.category}", _AS_HELP, partial(fitting.refit_as, model), True)
        for model in context.session.listed_models
        if model.fingerprint != history.model
    ]
    for label, text, act, enabled in ways:
        if imgui.menu_item_simple(label, enabled=enabled):
            act()
        tooltip(text)


def _draw_confidence(context: PanelContext, fitting: Fitting) -> None:
    """How sure the camera is, or whether the photos agree; the line stays while a step without that is shown."""
    step, count = fitting.history.step, len(fitting.history.photos)
    imgui.align_text_to_frame_padding()
    if count > 1 and step is not None:
        agree = explained(step.psnr) > _AGREE
        _draw_dot_and_words(context, f"{count} photos {'agree' if agree else 'disagree'}", agree, agree)
        tooltip("Whether one object, seen from the cameras that were found, explains all of them")
        return
    if step is None or step.confidence is None or step.uncertainty is None:
        imgui.text_disabled("Camera: not rated")
        tooltip("Only the end of a search is")
        return
    words = in_words(step.confidence)
    _draw_dot_and_words(context, f"Camera: {words}", words == "sure", words != "doubtful")
    tooltip(
        f"{step.confidence:.0%}: the probability that it is right to {RIGHT_DEGREES:.0f} degrees; if so, it is off by "
        f"about {step.uncertainty:.1f}. A doubtful one may be seen from the object's other side"
    )


def _draw_dot_and_words(context: PanelContext, words: str, sure: bool, likely: bool) -> None:
    """In the colours of the dots in *Mine*."""
    em, corner = hello_imgui.em_size(), imgui.get_cursor_screen_pos()
    colour = user_objects.COLOURS["sure" if sure else "likely" if likely else "doubtful"]
    middle = corner + ImVec2(0.4 * em, imgui.get_frame_height() / 2)
    imgui.get_window_draw_list().add_circle_filled(middle, 0.34 * em, packed(colour))
    imgui.set_cursor_pos_x(imgui.get_cursor_pos_x() + em)
    imgui.text_colored((*(context.palette.text if likely else context.palette.warm), 1.0), words)


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
    imgui.align_text_to_frame_padding()
    imgui.text("Photo")
    for number, source in enumerate(history.sources):
        imgui.same_line()
        imgui.begin_disabled(number >= len(history.photos))
        if imgui.radio_button(f"{number + 1}###photo {number + 1}", history.photo_index == number):
            fitting.view.show_photo(number)
        imgui.end_disabled()
        tooltip(source.name + (", its camera known" if source.pose else ""))


def _invitation(context: PanelContext) -> str:
    return (
        f"Drop a photo of {nouns(context)} anywhere on this window, or several of the same one. It is cut out and "
        "cropped, then camera, shape and texture are found. A plain background helps; on any other you point it out."
    )
