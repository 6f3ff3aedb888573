"""A question about a photo: the photo, the words, and a button or an image per answer."""

from collections.abc import Callable
from functools import partial

from imgui_bundle import ImVec2, hello_imgui, imgui

from core.models.model import Model
from viewer.context import PanelContext
from viewer.screen.file_dialog import is_there
from viewer.values.fit_history import Question
from viewer.values.printable import as_label
from viewer.widgets import object_tiles
from viewer.widgets.controls import button, flow, tooltip
from viewer.widgets.cut_out import draw_cut_out
from viewer.widgets.text import heading, paint_caption, small_height

POINT_HELP = "Show where the object is, by a click, a box, or strokes, and fit it"
_PICTURE = 7.0  # em, largest side of an object that stands for its category
_Answer = tuple[str, str, Callable[[], None]]  # label, tooltip and action of a button


def draw_question(context: PanelContext, question: Question) -> None:
    """Draw a photo in question, and its answers."""
    history = question.request.history
    heading(context, question.source.name)
    imgui.push_style_color(imgui.Col_.text, (*context.palette.warm, 1.0))
    imgui.text_wrapped(question.words)
    imgui.pop_style_color()
    preview = question.preview
    boxes = preview.boxes if preview else ()
    photo = history.photo.pixels if history.photo else context.session.photo_thumbnails.get(question.source.file)
    pixels = preview.pixels if preview else photo
    if pixels is not None:
        choose_object = partial(context.session.answers.choose, history.sources, question.number, model=history.model)
        draw_cut_out(context, pixels, boxes, choose_object)
    doubtful = question.is_about_category
    if doubtful and not question.neither:
        _draw_categories(context, question)
    for number, (label, text, act) in enumerate(_answers(context, question)):
        if number:
            flow(label.partition("###")[0])
        likely = not number and (question.neither or not doubtful)
        if button(label, text, colour=context.palette.accent if likely else None):
            act()
    if doubtful and question.neither:
        _draw_categories(context, question)


def _answers(context: PanelContext, question: Question) -> list[_Answer]:
    """Return a question's buttons, the likeliest answer first."""
    answers = context.session.answers
    history = question.request.history
    point = partial(context.session.segmenting.open, history.sources, question.number, history.model)
    buttons: list[_Answer] = [("Point at it###point at it", POINT_HELP, point)]
    if question.is_failed and answers.needs_file(question) and not is_there(question.source.file):
        find = partial(context.find_photo, question)
        buttons = [("Find…###find photo", "Choose its file, which is not there any more, and fit it", find)]
    elif question.is_failed:
        again = partial(answers.try_again, question.request)
        buttons.insert(0, ("Try again###try again", "Fit this photo once more", again))
    elif question.cut and question.model:
        for model in reversed(_categories(context, question)):
            likely = model.fingerprint == question.model and not question.neither
            label = "This one###this one" if likely else f"As a {as_label(model.noun)}###as {model.category}"
            act = partial(answers.answer, question, model.fingerprint)
            buttons.insert(0, (label, f"Fit what is outlined, as a {model.noun}", act))
    several = question.is_about_category or (question.preview is not None and len(question.preview.boxes) > 1)
    words = "None of these" if question.neither or several else "Leave it"
    leave = f"{words}###leave photo", "Do not fit this photo", partial(answers.leave, question)
    return [leave, *buttons] if question.neither else [*buttons, leave]


def _categories(context: PanelContext, question: Question) -> list[Model]:
    """Return a listed model per category, the likely one first."""
    models = dict[str, Model]()
    for model in sorted(context.session.models, key=lambda listed: listed.fingerprint != question.model):
        models.setdefault(model.category, model)
    return [*models.values()]


def _draw_categories(context: PanelContext, question: Question) -> None:
    """Draw an object per category; a click fits the photo as one of them."""
    models = _categories(context, question)
    objects = context.session.editor.objects
    gap = hello_imgui.em_size(0.4)
    room = imgui.get_content_region_avail().x
    side = min(hello_imgui.em_size(_PICTURE), (room - gap * (len(models) - 1)) / len(models))
    for number, model in enumerate(models):
        if number:
            imgui.same_line(0, gap)
        corner = imgui.get_cursor_screen_pos()
        if object_tiles.tile_button(f"as {model.category}", (side, side + small_height())):
            context.session.answers.answer(question, model.fingerprint)
        hovered = imgui.is_item_hovered()
        tooltip(f"Fit what is outlined, as a {model.noun}")
        object_tiles.paint(context, objects[next(iter(objects.families[model.fingerprint]))].instance, corner, side)
        object_tiles.outline(corner, side, context.palette.accent if hovered else context.palette.line)
        paint_caption(context, f"A {model.noun}", corner + ImVec2(0, side), side)
