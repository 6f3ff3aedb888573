"""The Share dialog, which saves a page, film, image or mesh, with a preview."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any, TypeVar

import numpy as np
from imgui_bundle import ImVec2, hello_imgui, icons_fontawesome_4, imgui

from core.editing.size import size_of
from core.export.mesh_formats import FORMATS as MESHES
from core.export.mesh_formats import TEXTURED
from core.export.print_formats import LARGEST_PRINT, PRINTED
from core.export.video import FORMATS as VIDEOS
from core.export.video_frames import Image
from core.gl.background import Background, Rgb, background_rows
from core.models.model import Instance
from core.models.scene import IMAGE_FORMATS
from viewer.context import PanelContext
from viewer.screen.file_dialog import FileRequest
from viewer.screen.theme import Colour, packed
from viewer.values.duration import duration
from viewer.values.printable import printable
from viewer.values.share_settings import BACKGROUNDS, DIMENSIONS, FILMS, KINDS, WIDE, ShareSettings, films_of
from viewer.widgets import object_tiles
from viewer.widgets.controls import begin_dialog, button, choose, draw_progress, flow, tooltip

T = TypeVar("T")
_SAVE = icons_fontawesome_4.ICON_FA_DOWNLOAD
_ICONS = {
    "page": icons_fontawesome_4.ICON_FA_GLOBE,
    "film": icons_fontawesome_4.ICON_FA_FILM,
    "picture": icons_fontawesome_4.ICON_FA_CAMERA,
    "mesh": icons_fontawesome_4.ICON_FA_CUBE,
}
_ABOUT = {
    "page": "One file that opens on any phone or computer, where everyone can turn the object",
    "film": "The object from many sides, as a video",
    "swing": "From the photo's view to both sides and back: the sides that the photo knows",
    "turntable": "The object turning once round",
    "morph": "The object turning once round, while it becomes B and itself again; takes longer",
    "picture": "The object as an image. A png holds shape, texture and camera: drop it here to bring them back",
    "mesh": "The object as a coloured surface, for Blender, the web or a game",
}
_PREVIEW = {"page": "What is seen first", "picture": "As it is saved", "mesh": "The object that is saved"}
_TOGGLES = {kind: (f"{icon}  {KINDS.get(kind, 'Film')}###{kind}", _ABOUT[kind]) for kind, icon in _ICONS.items()}
_ON_A_PAGE = ("One file for any browser.", "Drag turns it, on phones too.", "Under 2 MB, works offline.")
_SIZES = {
    size: (f"{name}###{name.lower()}", f"{size} px")
    for size, name in ((256, "Small"), (512, "Standard"), (1080, "Large"))
}  # by px of height
_CELLS = {0: "Automatic"} | {cells: f"{cells} cells" for cells in (96, 128, 192, 256, 384, 512)}
_TRIANGLES = {0: "Automatic"} | {count: f"{count:,} at most" for count in (100_000, 30_000, 8_000, 2_000)}
_TEXTURES = {512: "Image, 512 px", 1024: "Image, 1024 px", 2048: "Image, 2048 px", 0: "At the vertices"}
_ROWS: dict[str, tuple[str, Mapping[Any, str], str]] = {
    "mesh": (
        "Format",
        {name: name for name in MESHES},
        "glb opens in most programs and holds the camera; it, usdz and obj name parts; "
        "stl and 3mf are for printers, in mm, 3mf with a filament for each part",
    ),
    "cells": ("Detail", _CELLS, "Along the object: more are finer, and slower"),
    "triangles": ("Triangles", _TRIANGLES, "Fewer for games, more for printing"),
    "texture": (
        "Colours",
        _TEXTURES,
        "An image shows more than vertices, on fewer triangles; a closed surface has its colours at the vertices",
    ),
    "picture": ("Format", {name: name for name in IMAGE_FORMATS}, "png loses nothing"),
    "video": (
        "Format",
        {name: video.label for name, video in VIDEOS.items()},
        "mp4 is the smallest, gif plays everywhere; png frames are a folder of images",
    ),
    "unit": (
        "Dimensions",
        DIMENSIONS,
        "Width, depth and height beside the object, as in a furniture catalogue; of a film on its last frame",
    ),
}  # labels, choices and tooltips by the settings' fields
_USES = {
    ".glb": ("Any program###glb", "glb: for Blender, the web and games"),
    ".usdz": ("AR for iPhone###usdz", "usdz: opened on an iPhone, it stands in the room in its true size"),
    ".3mf": ("3D print###3mf", "3mf: in mm, with a filament for each part"),
}  # formats by their use
_ROOM = "Phones place the object in the room. Writes a glb beside the page, which Android needs, on a web server"
_VERSIONS = "One file with all colours of this object: swatches of a page, variants of a glb"
_SIDE, _LABEL, _WIDTH = 16, 6.5, 13  # em: side of the preview, widths of labels and of controls
_CHECKS = 16  # px, side of a square in the pattern that stands for transparency


class ShareDialog:
    """The Share dialog."""

    def __init__(self) -> None:
        self._composite: tuple[Image, Background | None, np.ndarray] | None = None  # image, background, both as one
        self._more = False  # further choices are unfolded
        self._height = 0.0  # px of preview and choices, at least: the button below stays where it is

    def draw(self, context: PanelContext) -> None:
        """Draw the dialog while it is open."""
        exporting = context.session.exporting
        if not context.share_open:
            exporting.preview.close()
            exporting.films.close()
            self._height = 0.0
            return
        visible, context.share_open = begin_dialog("Share")
        if visible:
            exporting.preview.update(_as_in_view(context, context.preferences.share))
            self._draw_content(context)
        imgui.end()

    def _draw_content(self, context: PanelContext) -> None:
        settings = context.preferences.share
        em = hello_imgui.em_size()
        changed = replace(settings, kind=_draw_kinds(settings.kind))
        if changed.kind not in FILMS:
            context.session.exporting.films.close()
        imgui.spacing()
        top = imgui.get_cursor_pos_y()
        room = imgui.get_main_viewport().work_size.x / em - _LABEL - _WIDTH - 3
        self._draw_preview(context, _as_in_view(context, changed), min(_SIDE, room) * em)
        imgui.same_line(0, em)
        imgui.begin_group()
        if changed.kind == "page":
            for line in _ON_A_PAGE:
                imgui.text(line)
            changed = _draw_switches(context, _row(changed, "unit"))
        else:
            changed = self._draw_choices(context, changed)
        imgui.end_group()
        used = imgui.get_cursor_pos_y() - top
        self._height = max(self._height, used)
        if used < self._height:
            imgui.dummy((0, self._height - used - imgui.get_style().item_spacing.y))
        imgui.spacing()
        _draw_foot(context, changed)
        if changed != settings:
            context.set_preference(share=changed)

    def _draw_choices(self, context: PanelContext, settings: ShareSettings) -> ShareSettings:
        """Draw the choices of a film, an image or a mesh, the further ones folded away; return the changed settings."""
        room = _LABEL + _WIDTH - 0.6
        if settings.kind in FILMS:
            settings = _draw_films(context, settings, room)
        if settings.kind == "mesh":
            settings = replace(settings, mesh=_draw_toggles(settings.mesh, _USES, room / len(_USES)))
            settings = _draw_switches(context, settings)
        else:
            settings = replace(settings, size=_draw_toggles(settings.size, _SIZES, room / len(_SIZES)))
        if button("Less###more" if self._more else "More…###more", "Format, background, and choices that few change"):
            self._more = not self._more
        return _draw_form(settings, context.session.editor.scene.instance) if self._more else settings

    def _draw_preview(self, context: PanelContext, settings: ShareSettings, side: float) -> None:
        image = context.session.exporting.preview.image
        if image is None:
            imgui.dummy((side, side / WIDE if settings.wide else side))
            return
        if self._composite is None or self._composite[0] is not image or self._composite[1] != settings.behind:
            self._composite = image, settings.behind, _on_background(image, settings.behind)
        corner = imgui.get_cursor_screen_pos()
        size = ImVec2(side, side * image.shape[0] / image.shape[1])
        imgui.image(context.texture(self._composite[2]), size)
        if context.session.exporting.preview.stale:
            veil = packed(context.palette.panel, object_tiles.DIMMED)
            imgui.get_window_draw_list().add_rect_filled(corner, corner + size, veil)
        tooltip(_PREVIEW.get(settings.kind, "The first frame"))


def _as_in_view(context: PanelContext, settings: ShareSettings) -> ShareSettings:
    top, bottom = (_rgb(colour) for colour in context.palette.background)
    editor = context.session.editor
    wide = editor.model.category == "cars" and settings.kind != "page"
    settings = settings.film_of(editor.scene, editor.film_partner)
    return replace(settings, view_background=(top, bottom), wide=wide)


def _rgb(colour: Colour) -> Rgb:
    red, green, blue = (round(255 * channel) for channel in colour)
    return red, green, blue


def _on_background(image: Image, background: Background | None) -> np.ndarray:
    """Return an RGBA image on a background or, for None, on a pattern that stands for transparency."""
    rows, columns = (np.arange(size) // _CHECKS for size in image.shape[:2])
    checks = np.where((rows[:, None] + columns) % 2, 205, 240)[..., None]
    opacity = image[..., 3:] / 255
    behind = checks if background is None else background_rows(background, len(image))
    return (image[..., :3] * opacity + behind * (1 - opacity) + 0.5).astype(np.uint8)


def _draw_kinds(kind: str) -> str:
    """Draw the choice between a page, a film, a picture and an object; return the kind of file."""
    film = kind if kind in FILMS else next(iter(FILMS))
    toggles = {film if name == "film" else name: words for name, words in _TOGGLES.items()}
    width = min(7.2, (imgui.get_main_viewport().work_size.x / hello_imgui.em_size() - 3) / len(toggles))
    return _draw_toggles(kind, toggles, width)


def _draw_toggles(selected: T, toggles: Mapping[T, tuple[str, str]], width: float) -> T:
    """Draw buttons side by side and return the chosen value.

    Args:
        toggles: label and tooltip by value.
        width: em of each.
    """
    for value, (label, text) in toggles.items():
        colour = imgui.Col_.button_active if value == selected else imgui.Col_.button
        imgui.push_style_color(imgui.Col_.button, imgui.get_style_color_vec4(colour))
        if button(label, text, width):
            selected = value
        imgui.pop_style_color()
        imgui.same_line(0, hello_imgui.em_size(0.3))
    imgui.new_line()
    return selected


def _draw_films(context: PanelContext, settings: ShareSettings, room: float) -> ShareSettings:
    """Draw a moving preview of each film over its button, and its sources; return the changed settings.

    Args:
        room: em of all films.
    """
    editor = context.session.editor
    previews = context.session.exporting.films
    film = _as_in_view(context, settings)
    previews.update(film)
    kinds = films_of(editor.scene, editor.film_partner)
    corner = imgui.get_cursor_screen_pos()
    width = room / len(kinds)
    size = ImVec2(width, width / WIDE if film.wide else width) * hello_imgui.em_size()
    selected = film.kind
    for number, kind in enumerate(kinds):
        position = corner + ImVec2(number * (size.x + hello_imgui.em_size(0.3)), 0)
        imgui.set_cursor_screen_pos(position)
        selected = kind if imgui.invisible_button(f"##preview {kind}", size) else selected
        tooltip(_ABOUT[kind])
        frame = previews.frame(kind, imgui.get_time())
        if frame is not None:
            imgui.get_window_draw_list().add_image(context.texture(frame), position, position + size)
    selected = _draw_toggles(selected, {kind: (f"{FILMS[kind]}###{kind}", _ABOUT[kind]) for kind in kinds}, width)
    if editor.scene.instance.detail:
        imgui.text_disabled(_sources(previews.photo_shares(selected)))
        tooltip("Sources of the colours in this film. What neither the photo nor its mirror image shows is the model's")
    if previews.moving:
        context.session.jobs.worker.wake()
    return settings if selected == film.kind else replace(settings, kind=selected)


def _sources(shares: tuple[float, float] | None) -> str:
    """Describe the fractions of a film's colours that come from the photo and from its mirror image."""
    if shares is None:
        return "Comparing with the photo …"
    photo, mirrored = shares
    return f"{photo:.0%} as in the photo, {mirrored:.0%} mirrored, {1 - photo - mirrored:.0%} guessed"


def _draw_switches(context: PanelContext, settings: ShareSettings) -> ShareSettings:
    """Draw the switches of further contents of a page or a mesh; return the changed settings."""
    if settings.kind == "page":
        settings = replace(settings, room=imgui.checkbox("In the room, on phones###room", settings.room)[1])
        tooltip(_ROOM)
    if settings.holds_versions and (count := len(context.session.names.colours())) > 1:
        checked = imgui.checkbox(f"All versions ({count})###versions", settings.all_versions)[1]
        settings = replace(settings, all_versions=checked)
        tooltip(_VERSIONS)
    return settings


def _draw_form(settings: ShareSettings, instance: Instance) -> ShareSettings:
    """Draw the further choices for a kind of file, a line each; return the changed settings."""
    if settings.kind == "mesh":
        for name in ("mesh", "cells", "triangles"):
            settings = _row(settings, name)
        if settings.mesh in TEXTURED:
            settings = _row(settings, "texture")
        if settings.mesh in PRINTED:
            metres = settings.mesh_settings(instance).metres or max(size_of(instance)) / 100
            if metres > LARGEST_PRINT:
                imgui.text_disabled("Larger than any printer builds")
        return settings
    settings = _row(settings, "picture" if settings.kind == "picture" else "video")
    return _draw_background(_row(settings, "unit"))


def _draw_background(settings: ShareSettings) -> ShareSettings:
    able = {name: label for name, label in BACKGROUNDS.items() if name != "transparent" or settings.can_be_transparent}
    current = settings.background if settings.background in able else "white"
    _label("Background")
    width = _WIDTH - 2.5 if current == "colour" else _WIDTH
    selected = choose(
        "background", current, able, "What is behind the object; mp4 and jpg cannot be transparent", width
    )
    if selected != current:
        settings = replace(settings, background=selected)
    if settings.background == "colour":
        imgui.same_line()
        colour = [channel / 255 for channel in settings.colour]
        red, green, blue = imgui.color_edit3("##colour", colour, imgui.ColorEditFlags_.no_inputs)[1]
        settings = replace(settings, colour=_rgb((red, green, blue)))
    return settings


def _row(settings: ShareSettings, name: str) -> ShareSettings:
    """Draw the choices of one setting, by its field's name."""
    label, choices, text = _ROWS[name]
    _label(label)
    return replace(settings, **{name: choose(name, getattr(settings, name), choices, text, _WIDTH)})


def _label(text: str) -> None:
    """Draw a label, and begin the control beside it."""
    imgui.align_text_to_frame_padding()
    imgui.text(text)
    imgui.same_line(hello_imgui.em_size(_LABEL))


def _is_entered() -> bool:
    """Return whether Enter was pressed in the dialog and is not meant for a control that the keyboard has chosen."""
    is_free = imgui.is_window_focused() and not (imgui.get_io().nav_visible or imgui.is_any_item_active())
    return is_free and any(map(imgui.is_key_pressed, (imgui.Key.enter, imgui.Key.keypad_enter)))


def _draw_foot(context: PanelContext, settings: ShareSettings) -> None:
    """Draw the button that saves, or progress; below, the path of the last saved file."""
    exporting = context.session.exporting
    if not draw_progress(context, *KINDS):
        idle = not exporting.running
        accent = context.palette.accent
        word = KINDS[settings.kind].lower()
        name = f"{context.file_name}-{settings.kind}{settings.suffix}"
        save = partial(exporting.share, settings=_as_in_view(context, settings))
        where = f"As {printable(name)}\nin {printable(str(context.files.saves))}"
        is_pressed = button(f"{_SAVE}  Save {word}###save here", where, 10, idle, accent)
        if is_pressed or (idle and _is_entered()):
            save(context.files.unused(name))
        flow("Save as…")
        if button("Save as…###save", "Choose name and folder, which is where the next file is saved, too", 0, idle):
            context.files.ask(FileRequest(f"Save the {settings.kind} as", save, (settings.suffix,), True, name))
        if (seconds := exporting.preview.seconds) is not None:
            imgui.same_line()
            imgui.align_text_to_frame_padding()
            imgui.text_disabled(f"Takes about {duration(seconds)}")
    if (saved := exporting.saved) is not None:
        imgui.align_text_to_frame_padding()
        imgui.text(printable(f"Saved to {saved.parent.name}/{saved.name}"))
        tooltip(str(saved))
        flow("Show in folder")
        if button("Show in folder###show in folder", "Open the folder that the file is in"):
            context.show_in_folder(saved)
