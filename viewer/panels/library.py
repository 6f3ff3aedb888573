"""Everything to begin with: a photo, what one has made oneself, and the model's objects as thumbnails."""

from collections.abc import Iterable, Sequence

from imgui_bundle import ImVec2, hello_imgui, icons_fontawesome_4, imgui

from core.models.model import Model
from viewer.context import Panel, PanelContext
from viewer.screen.theme import WARM, Colour, mixed, packed
from viewer.values.fit_history import FitRequest
from viewer.values.part import PARTS
from viewer.values.variety import family, readable
from viewer.widgets import object_tiles, user_objects, waiting_tiles
from viewer.widgets.controls import action_button, draw_choice, tooltip
from viewer.widgets.object_tiles import unmixable
from viewer.widgets.text import caption, heading, paint_caption, small_height
from viewer.widgets.welcome import draw_samples

_INVITATION = "What you rebuild from photos comes here. Try one:"
_ALL, _MINE = "all", "mine"
_PHOTO = icons_fontawesome_4.ICON_FA_IMAGE
_OPEN, _SHUT = icons_fontawesome_4.ICON_FA_CARET_DOWN, icons_fontawesome_4.ICON_FA_CARET_RIGHT


class LibraryPanel(Panel):
    """Click an object to show it (it is A), drag it to a slot, or right click it to choose."""

    title = "Library"
    dock = "Left"

    def __init__(self) -> None:
        self._user_menu = user_objects.UserObjectMenu()
        self._unfolded = set[str]()  # the objects whose variants are shown
        self._filter = _ALL  # which objects are listed: all, one's own, or those of a model, by its fingerprint

    def draw(self, context: PanelContext) -> None:
        """The button, one's own objects, those of the models; those out of sight are not rendered."""
        label = (
            f"{_PHOTO}  Open photo…" if imgui.get_content_region_avail().x > hello_imgui.em_size(8) else "Open photo"
        )
        action_button(context, "fit_image", label, -1, context.palette.accent)
        names = _headings(context.session.listed_models)
        choices = {_ALL: "All", **names, _MINE: "Mine"}
        self._filter = draw_choice(choices, self._filter if self._filter in choices else _ALL)
        if imgui.begin_child("objects"):
            if self._filter in (_ALL, _MINE):
                heading(context, "Mine")
                self._draw_mine(context)
            for model, name in names.items():
                if self._filter in (_ALL, model):
                    imgui.spacing()
                    heading(context, name)
                    self._draw_tiles(context, self._listed(context.session.editor.objects.families[model]))
        imgui.end_child()
        self._user_menu.apply(context)

    def _draw_mine(self, context: PanelContext) -> None:
        mine: list[str | FitRequest] = [*context.session.fitting.queue, *context.session.editor.objects.own]
        if mine:
            self._draw_tiles(context, mine)
        else:
            caption(context, _INVITATION)
            draw_samples(context)

    def _listed(self, families: dict[str, tuple[str, ...]]) -> list[str]:
        """One of each form, and the variants of those that are unfolded behind them."""
        names = list[str]()
        for head, variants in families.items():
            names += [head, *variants] if head in self._unfolded else [head]
        return names

    def _draw_tiles(self, context: PanelContext, tiles: Sequence[str | FitRequest]) -> None:
        """Of objects, by their names, and of photos that wait."""
        em, room = hello_imgui.em_size(), imgui.get_content_region_avail().x
        gap, least = 0.4 * em, object_tiles.THUMBNAIL * em
        columns = max(1, int((room + gap) / (least + gap)))
        side = min(room, 1.25 * least, (room - gap * (columns - 1)) / columns)
        height = side + small_height()
        imgui.push_style_var(imgui.StyleVar_.item_spacing, (gap, gap))
        for first in range(0, len(tiles), columns):
            if not imgui.is_rect_visible((room, height)):  # hundreds of objects cost nothing while scrolled away
                imgui.dummy((room, height))
                continue
            for column, tile in enumerate(tiles[first : first + columns]):
                if column:
                    imgui.same_line()
                after = imgui.get_cursor_pos()
                self._draw_tile(context, tile, imgui.get_cursor_screen_pos(), ImVec2(side, height))
                imgui.set_cursor_pos(after)
                imgui.dummy((side, height))
        imgui.pop_style_var()

    def _draw_tile(self, context: PanelContext, tile: str | FitRequest, corner: ImVec2, size: ImVec2) -> None:
        imgui.set_next_item_allow_overlap()
        below = corner + ImVec2(0, size.x)
        if isinstance(tile, FitRequest):
            waiting_tiles.draw(context, tile, corner, size)
            paint_caption(context, tile.history.sources[0].name, below, size.x)
            return
        families = context.session.editor.objects.families_of(tile)
        _draw_object(context, tile, corner, size, self._user_menu)
        paint_caption(context, readable(family(tile) if tile in families else tile), below, size.x)
        if variants := families.get(tile, ()):
            self._draw_fold(context, tile, len(variants), corner, size.x)

    def _draw_fold(self, context: PanelContext, name: str, count: int, corner: ImVec2, side: float) -> None:
        """The number of an object's variants, in the corner of its thumbnail."""
        unfolded, em = name in self._unfolded, hello_imgui.em_size()
        label = f"{_OPEN if unfolded else _SHUT} {count}"
        size = imgui.calc_text_size(label) + ImVec2(0.5 * em, 0)
        low = corner + ImVec2(side, side) - size
        imgui.set_cursor_screen_pos(low)
        if imgui.invisible_button(f"variants of {name}", size):
            self._unfolded ^= {name}
        colour = mixed(context.palette.panel, context.palette.accent, 0.5 if imgui.is_item_hovered() else 0.0)
        tooltip(
            "Fold its variants away" if unfolded else f"Show {count} variant{'s' if count > 1 else ''} of this form"
        )
        draw = imgui.get_window_draw_list()
        draw.add_rect_filled(low, low + size, packed(colour, 0.85), object_tiles.rounding())
        draw.add_text(low + ImVec2(0.25 * em, 0), packed(context.palette.text), label)


def _draw_object(
    context: PanelContext, name: str, corner: ImVec2, size: ImVec2, user_menu: user_objects.UserObjectMenu
) -> None:
    editor, side = context.session.editor, size.x
    if imgui.invisible_button(f"show {name}", size):
        editor.show_object(name)
    hovered = imgui.is_item_hovered()
    about = f"{readable(name)}{user_objects.about(editor.objects[name])}"
    tooltip(f"{about}\nClick to show it, drag it to a slot, right click to choose")
    if imgui.begin_drag_drop_source():
        context.dragged = name
        imgui.set_drag_drop_payload_py_id(object_tiles.DRAGGED, 0)
        imgui.text(readable(name))
        imgui.end_drag_drop_source()
    if imgui.begin_popup_context_item():
        _draw_menu(context, name)
        if name in editor.objects.own:
            user_menu.draw(context, name)
        imgui.end_popup()
    object_tiles.paint(context, name, corner, side)
    draw = imgui.get_window_draw_list()
    for number, (label, colour) in enumerate(_marks(context, name)):
        object_tiles.outline(corner, side, colour, inset=2.0 * number)
        object_tiles.mark(corner + ImVec2(number * 1.3 * hello_imgui.em_size(), 0), label, colour)
    if hovered:
        draw.add_rect_filled(corner, corner + ImVec2(side, side), packed((1, 1, 1), 0.12), object_tiles.rounding())
    user_objects.draw_dot(context, name, corner, side)


def _draw_menu(context: PanelContext, name: str) -> None:
    editor, grid = context.session.editor, context.session.grid
    mixable = editor.is_mixable(name)
    why = "" if mixable else unmixable(context, name)
    if imgui.menu_item_simple("Show it"):
        editor.show_object(name)
    for part in PARTS:
        if imgui.menu_item_simple(f"Take only its {part}", enabled=mixable and part not in editor.locked):
            editor.take(part, name)
        tooltip(why)
    if imgui.menu_item_simple("Make it B", enabled=mixable):
        editor.set_b(name)
    tooltip(why)
    if imgui.menu_item_simple("Add to the grid"):
        grid.add(name)
        context.focus = "Grid"


def _headings(models: Iterable[Model]) -> dict[str, str]:
    """The names of the models' objects, by fingerprint; a second model of a category is numbered."""
    names = dict[str, str]()
    for model in models:
        name = model.category.capitalize() or "Objects"
        count = sum(known.split(" (")[0] == name for known in names.values())
        names[model.fingerprint] = f"{name} ({count + 1})" if count else name
    return names


def _marks(context: PanelContext, name: str) -> list[tuple[str, Colour]]:
    """The role of an object just now: A, what A's shape or texture was taken from, B."""
    mix, accent = context.session.editor.state.mix, context.palette.accent
    if mix.a == (name, name):
        marks = [("A", accent)]
    else:
        marks = [(object_tiles.ICONS[part], accent) for part in PARTS if getattr(mix.a, part) == name]
    return [*marks, ("B", WARM)] if mix.b == name else marks
