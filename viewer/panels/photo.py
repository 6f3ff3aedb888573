"""The panel of the object's photo: its cut-out, its camera, its detail, and the object's paint."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from imgui_bundle import ImVec2, hello_imgui, icons_fontawesome_4, imgui

from core.fitting.category_check import describe_difference
from core.fitting.confidence import RIGHT_DEGREES, explained, in_words
from core.models.photo_detail import PhotoDetail
from viewer.activities.fitting import Fitting
from viewer.context import Panel, PanelContext
from viewer.screen.theme import packed
from viewer.values.fit_history import FitHistory
from viewer.values.printable import as_label
from viewer.widgets import user_objects, waiting_tiles
from viewer.widgets.comparison import object_pixels
from viewer.widgets.controls import button, end_gesture, flow, labelled_slider, tooltip
from viewer.widgets.cut_out import draw_cut_out
from viewer.widgets.paint import draw_paint
from viewer.widgets.photo_strip import draw_strip, draw_unseen_side
from viewer.widgets.question import POINT_HELP, draw_question
from viewer.widgets.text import heading
from viewer.widgets.welcome import draw_samples, nouns

_AGAIN = f"Try again  {icons_fontawesome_4.ICON_FA_CARET_DOWN}"
_TOOLS = {
    "wipe": ("Compare", "Drag in the view: the photo on the left, the render on the right"),
    "erase": ("Erase", "Drag over a reflection, say, to take it off the object; the wheel sets the brush's size"),
}  # labels and tooltips of tools over the view
_LOST_HELP = "Open the photo again to fit it anew"
_VIEWPOINT_HELP = (
    "Look from the side that the photo may show instead, mostly the opposite one; the object stays as it is"
)
_FROM_HERE_HELP = "Fit again from this side, as a new object"
_VIEW_HELP = "For a camera that was not found: turn the object in the view until it looks as in the photo, then click"
_DETAIL_HELP = """How much of the photo's own detail the object shows, such as its outline and lettering, in files too.
A doubtful camera shows none."""
_AGREE = 0.5  # least explained fraction (:func:`explained`) of photos that agree


class PhotoPanel(Panel):
    """Shows waiting photos, the fit that is followed, else a question, else the photo of the object on screen."""

    title = "Photo"
    dock = "Right"

    def draw(self, context: PanelContext) -> None:
        """Draw the question, the photo with its controls or, without a photo, an invitation."""
        fitting = context.session.fitting
        history = fitting.shown
        question = fitting.question
        sources = question.request.history.sources if question else history.sources
        if any(request.history.sources is not sources for request in fitting.pending):
            waiting_tiles.draw_row(context)
        if question:
            draw_question(context, question)
        elif history.sources or context.session.photo_view:
            _draw_object(context, history)
        else:
            heading(context, "Photo")
            imgui.text_wrapped(
                f"Drop a photo of {nouns(context)} anywhere on this window, or several of the same one. It is cut"
                " out, then camera, shape and texture are found."
            )
            draw_samples(context)
            draw_paint(context)


def _draw_object(context: PanelContext, history: FitHistory) -> None:
    """Draw the photo of the object on screen and, once it is fitted, its controls."""
    session = context.session
    fitting = context.session.fitting
    photo = history.photo
    heading(context, history.name or session.editor.state.mix.a.shape)
    draw_strip(context, history)
    preview = photo.preview if photo else fitting.view.preview if history is fitting.history else None
    fits = fitting.running and session.viewport.following
    view = None if fits else session.photo_view  # that of the object on screen
    pixels = preview.pixels if preview else session.whole_photo if view else None
    if pixels is None:
        pixels = object_pixels(view.image) if view else photo.pixels if photo else None
    if pixels is not None:
        boxes = preview.boxes if preview else ()
        draw_cut_out(
            context, pixels, boxes, partial(context.session.answers.choose, history.sources, history.photo_index)
        )
    if button("Point at it###point at it", POINT_HELP if history.sources else _LOST_HELP, enabled=photo is not None):
        session.segmenting.open(history.sources, history.photo_index, history.model)
    if fits:
        _draw_progress(context)
        return
    if history.photos:
        imgui.same_line()
        _draw_again(context, fitting, history)
    _draw_verdict(context, fitting, history)
    mix = session.editor.state.mix
    if detail := session.editor.scene.instance.detail:
        if not (mix.shape or mix.texture):  # else it has B's photos, or a part of both
            context.hints.ring = detail.azimuths
            draw_unseen_side(context, history, detail)
        _draw_tools(context)
    draw_paint(context)
    if detail:
        _draw_detail(context, detail)


def _draw_progress(context: PanelContext) -> None:
    fitting = context.session.fitting
    last = fitting.history.last
    imgui.same_line()
    later = "; you can go on later" if fitting.history.resume_point else ""
    if button("Stop###stop fit", f"End here and keep what has been found{later}"):
        fitting.stop()
    if last is not None:
        search = "Checking from other sides" if last.restart else "Finding camera, shape and texture"
        label = "Taking its own shape" if last.is_free else search
    elif fitting.view.read_fraction is not None:
        label = "Reading the video …"
    else:
        label = "Looking for the camera …" if fitting.history.photo or fitting.view.preview else "Cutting out …"
    imgui.progress_bar(fitting.view.read_fraction or fitting.history.progress, (-1, 0), label)


def _draw_again(context: PanelContext, fitting: Fitting, history: FitHistory) -> None:
    """Draw the menu of ways to fit the same object again."""
    if button(f"{_AGAIN}###again", "Fit the same photo once more"):
        imgui.open_popup("again")
    if not imgui.begin_popup("again"):
        return
    can_resume = history is fitting.history and not fitting.running and fitting.history.resume_point is not None
    ways: list[tuple[str, str, Callable[[], None], bool]] = [
        ("From the beginning###restart", "The whole search once more", fitting.refit, True),
        ("From the camera in the view###resume from view", _VIEW_HELP, fitting.resume_from_view, can_resume),
    ]
    ways += [
        (f"As a {as_label(model.noun)}###as {model.category}", "", partial(fitting.refit, model), True)
        for model in context.session.models
        if model.fingerprint != history.model
    ]
    for label, text, act, enabled in ways:
        if imgui.menu_item_simple(label, enabled=enabled):
            act()
        if text:
            tooltip(text)
    imgui.end_popup()


def _draw_verdict(context: PanelContext, fitting: Fitting, history: FitHistory) -> None:
    """Draw the camera's confidence, in doubt with another viewpoint, or several photos' agreement."""
    step = history.last
    confidence = context.session.editor.objects[context.session.editor.state.mix.a.shape].confidence
    if len(history.photos) > 1 and step is not None:
        first, *later = (fitted.photo.categories for fitted in history.photos)
        differ = any(describe_difference(first, categories) for categories in later)
        agree = explained(step.psnr) > _AGREE and not differ and not step.left_out
        words = f"{len(history.photos)} photos {'agree' if agree else 'disagree'}"
        if step.left_out:
            words = f"{history.photos[step.left_out[0]].source.name} shows another object"
        _draw_dot_and_words(context, words, "doubtful" if not agree else in_words(confidence) if confidence else "sure")
        tooltip("Whether one object, seen from the cameras that were found, explains all of them")
        return
    if confidence is None:
        return
    sure = in_words(confidence)
    _draw_dot_and_words(context, f"Camera: {sure}", sure)
    tooltip(f"{confidence:.0%}: the probability that it is right to {RIGHT_DEGREES:.0f} degrees")
    if sure != "sure" and history is fitting.history and step and step.runner_up:
        imgui.same_line()
        is_other = fitting.view.from_runner_up
        if button(f"{'First' if is_other else 'Other'} viewpoint###viewpoint", _VIEWPOINT_HELP):
            fitting.view.show_viewpoint(not is_other)
        if is_other:
            flow("Fit from here")
            if button("Fit from here###fit from here", _FROM_HERE_HELP, enabled=not fitting.running):
                fitting.resume_from_view()


def _draw_dot_and_words(context: PanelContext, words: str, sure: str) -> None:
    """Draw a line of text behind a dot in the colour of a confidence, as on tiles."""
    em = hello_imgui.em_size()
    middle = imgui.get_cursor_screen_pos() + ImVec2(0.4 * em, imgui.get_frame_height() / 2)
    imgui.get_window_draw_list().add_circle_filled(middle, 0.34 * em, packed(user_objects.COLOURS[sure]))
    imgui.set_cursor_pos_x(imgui.get_cursor_pos_x() + em)
    imgui.align_text_to_frame_padding()
    imgui.text_colored((*(context.palette.warm if sure == "doubtful" else context.palette.text), 1.0), words)


def _draw_tools(context: PanelContext) -> None:
    """Draw the tools for the view; a second press turns the object again."""
    for number, (tool, (label, words)) in enumerate(_TOOLS.items()):
        if number:
            imgui.same_line()
        is_on = tool == context.tool
        if button(f"{label}###{tool}", words, colour=context.palette.accent if is_on else None):
            context.tool = "turn" if is_on else tool
            context.session.see_from("photo")


def _draw_detail(context: PanelContext, detail: PhotoDetail) -> None:
    """Draw the strength of the photo detail."""
    editor = context.session.editor
    percent = f"{detail.strength:.0%}"
    changed, strength = labelled_slider("photo detail", "Photo detail", detail.strength, (0.0, 1.0), percent, (6, 3))
    if changed:
        editor.set_detail(replace(detail, strength=strength), "photo detail")
    end_gesture(context)
    tooltip(_DETAIL_HELP)
