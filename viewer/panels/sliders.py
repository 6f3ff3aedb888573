"""Shape and texture along directions of the trained codes: principal ones, and those that were given a name."""

from imgui_bundle import ImVec2, hello_imgui, icons_fontawesome_4, imgui

from core.geometry.camera import Camera
from core.models.codes import Codes
from core.models.model import Model
from core.rendering.progressive import Frame
from viewer.activities.thumbnails import SIZE
from viewer.context import Panel, PanelContext
from viewer.values import orbit
from viewer.values.direction import Direction
from viewer.values.influence import CodeInfluence
from viewer.values.part import PARTS, Part
from viewer.widgets import object_tiles
from viewer.widgets.controls import action_button, button, choose, end_gesture, flow, tooltip, tooltip_beside
from viewer.widgets.directions import FILTER, DirectionMenu, NewDirection, in_words
from viewer.widgets.text import push_small

_DICE, _PIN = icons_fontawesome_4.ICON_FA_RANDOM, icons_fontawesome_4.ICON_FA_THUMBTACK
_SHOWN = FILTER | {PARTS: "All"}
_PARTS_WIDTH = 7  # em
_FIRST = 6  # sliders shown at first
_REACH = 3.0  # standard deviations to either side
_STEPS = (-2, 0, 2)  # standard deviations at which a strip shows the object
_INFLUENCE = 96  # px
_HELP = "Ctrl+click to type, right click for 0"
_STRIPS_HELP = "Under every slider what the object would be like at -2, 0 and +2; click one to go there"


class SlidersPanel(Panel):
    """The named directions, and a column of principal ones for each part. A slider changes its strength only."""

    title = "Sliders"
    dock = "Right"

    def __init__(self) -> None:
        self._all = False
        self._parts: tuple[Part, ...] = PARTS  # what is shown
        self._strips = True
        self._new, self._menu = NewDirection(), DirectionMenu()
        self._model: Model | None = None  # whose thumbnails and principal directions these are
        self._principal: dict[Part, tuple[Direction, ...]] = {}
        self._named: tuple[Direction, ...] = ()
        self._basis: Codes | None = None  # what the strips lead away from: the object before the drag began
        self._targets: dict[tuple[str, int], tuple[Codes, Camera]] = {}  # what every place shows
        self._influence: tuple[tuple[Part, ...], Frame, Frame, CodeInfluence] | None = None  # at less, at more, between
        self._last: dict[tuple[str, int], Frame] = {}  # the last thumbnail of every place, until there is a newer one

    @property
    def influence(self) -> tuple[tuple[Part, ...], CodeInfluence] | None:
        """The codes that the slider under the mouse moves, and what it changes."""
        return (self._influence[0], self._influence[3]) if self._influence else None

    def draw(self, context: PanelContext) -> None:
        """Named ones above, shape and texture side by side below."""
        self._follow(context)
        self._draw_top(context)
        if imgui.begin_child("sliders"):
            self._draw_named(context)
            if imgui.begin_table("kinds", len(self._parts), imgui.TableFlags_.sizing_stretch_same):
                for part in self._parts:
                    imgui.table_next_column()
                    self._draw_part(context, part)
                imgui.end_table()
            most = max(map(len, self._principal.values()))
            if most > _FIRST:
                _, self._all = imgui.checkbox(f"All {most} directions###all", self._all)
                tooltip("Those that explain less as well")
        imgui.end_child()
        self._new.draw(context)

    def _follow(self, context: PanelContext) -> None:
        """Forget what belonged to another model, other directions, or another object."""
        editor = context.session.editor
        if self._model is not editor.model:
            book = editor.model.codes
            self._model, self._last, self._targets = editor.model, {}, {}
            self._principal = {
                part: tuple(Direction.principal(book, part, index) for index in range(len(editor.space(part).std)))
                for part in PARTS
            }
        if self._named is not editor.state.directions:
            self._named, self._targets = editor.state.directions, {}
        if not editor.history.gesture and self._basis is not editor.scene.codes:
            self._basis, self._targets = editor.scene.codes, {}

    def _draw_top(self, context: PanelContext) -> None:
        action_button(context, "sample_all", f"{_DICE}  Random")
        flow("Thumbnails" + 6 * " ")
        _, self._strips = imgui.checkbox("Thumbnails###strips", self._strips)
        tooltip(_STRIPS_HELP)
        flow("parts", _PARTS_WIDTH)
        self._parts = choose("parts", self._parts, _SHOWN, "Which directions are shown", _PARTS_WIDTH)

    def _draw_named(self, context: PanelContext) -> None:
        if button(f"{_PIN}  Name a direction…###name mix", "Give the way from A to B a name, such as: sportier"):
            self._new.ask()
        for index, direction in enumerate(self._named):
            if direction.step.model == context.session.editor.model.fingerprint and set(direction.parts) & set(
                self._parts
            ):
                key = f"named {index + 1}"
                self._menu.draw(context, index, f"{direction.name}###menu {key}")
                imgui.begin_disabled(bool(context.session.editor.locked & set(direction.parts)))
                self._draw_slider(context, key, direction, f"It changes the {in_words(direction.parts)}")
                imgui.end_disabled()

    def _draw_part(self, context: PanelContext, part: Part) -> None:
        editor = context.session.editor
        imgui.begin_disabled(part in editor.locked)
        imgui.align_text_to_frame_padding()
        imgui.text(part.capitalize())
        imgui.same_line()
        if button(f"{_DICE}###Random {part}", f"Random: a {part} sampled from the distribution of the trained ones"):
            editor.sample(part)
        if button(f"Mean##{part}", f"The mean {part} of the trained objects"):
            editor.set_to_mean(part)
        flow("Reset")
        if button(f"Reset##{part}", f"The {part} of object A"):
            editor.reset_to_object(part)
        shares = editor.space(part).explained_variance.tolist()
        for index, direction in enumerate(self._principal[part][: None if self._all else _FIRST]):
            key, word = f"{part} {index + 1}", context.session.word(part, index)
            label = word.capitalize() or f"{part.capitalize()} {index + 1}"
            if _small_button(f"{label}  {_PIN}###name {key}", "Give this direction another name, and keep it above"):
                self._new.ask(direction)
            about = f"To the right: {word}" if word else f"Changes the {part} in a way that has no word"
            self._draw_slider(context, key, direction, about, f"{shares[index]:.0%} of how {part}s differ; now ")
        imgui.end_disabled()

    def _draw_slider(
        self, context: PanelContext, key: str, direction: Direction, about: str, numbers: str = ""
    ) -> None:
        """The slider, then where it leads."""
        editor = context.session.editor
        value = editor.strength(direction)
        imgui.set_next_item_width(-1)
        moved, to = imgui.slider_float(f"##{key}", value, -_REACH, _REACH, "")
        if moved and abs(to - value) > 1e-6:
            editor.move_along(direction, to, gesture=key)
        end_gesture(context)
        if imgui.is_item_clicked(imgui.MouseButton_.right):
            editor.move_along(direction, 0.0)
        if imgui.is_item_hovered() and not imgui.is_item_active():
            changes = self._show_influence(context, direction)
            tooltip_beside(f"{about}{changes}", f"{numbers}{value:+.2f} σ\n{_HELP}")
        if self._strips:
            self._draw_strip(context, key, direction)

    def _show_influence(self, context: PanelContext, direction: Direction) -> str:
        """Where the view changes between a standard deviation less and one more, over the object; and in words."""
        editor = context.session.editor
        camera = editor.scene.camera.resized(_INFLUENCE, _INFLUENCE)
        codes, mean, value = editor.scene.codes, editor.model.codes.mean, editor.strength(direction)
        ends = (direction.moved(codes, mean, value + step) for step in (-1.0, 1.0))
        low, high = (context.session.thumbnails.get(one, camera, soon=True) for one in ends)
        if low is None or high is None or low.resolution != high.resolution:  # of one there is a finer render already
            return ""
        if self._influence is None or self._influence[1:3] != (low, high):
            self._influence = direction.parts, low, high, CodeInfluence.between(low, high)
        found = self._influence[3]
        context.overlay = found.image
        return f"\nThe glow over the object shows where. {_outline(found.leak)}"

    def _draw_strip(self, context: PanelContext, key: str, direction: Direction) -> None:
        """Each thumbnail is below its value on the slider."""
        width = imgui.get_content_region_avail().x
        side = min(3.2 * hello_imgui.em_size(), width / len(_STEPS) - 2)
        corner = imgui.get_cursor_screen_pos()
        seen = imgui.is_rect_visible((width, side))
        for to in _STEPS:
            place = corner + ImVec2(width * (0.5 + to / (2 * _REACH)) - side / 2, 0)
            imgui.set_cursor_screen_pos(place)
            if imgui.invisible_button(f"{key} at {to}", (side, side)):
                context.session.editor.move_along(direction, float(to))
            tooltip("Click to go there")
            if seen:
                frame, stale = self._thumbnail(context, key, direction, to)
                object_tiles.paint_frame(context, frame, place, side, stale)

    def _thumbnail(self, context: PanelContext, key: str, direction: Direction, to: int) -> tuple[Frame | None, bool]:
        """The newest there is, and whether it is stale: of the object before it was changed."""
        model, basis, place = context.session.editor.model, self._basis, (key, to)
        assert basis is not None
        if place not in self._targets:
            codes = direction.moved(basis, model.codes.mean, float(to))
            self._targets[place] = codes, orbit.home(model).resized(SIZE, SIZE)
        found = context.session.thumbnails.get(*self._targets[place])
        if found:
            self._last[place] = found
        return self._last.get(place), found is None


def _small_button(label: str, text: str) -> bool:
    push_small()
    imgui.push_style_color(imgui.Col_.button, (0, 0, 0, 0))
    pressed = imgui.small_button(label)
    imgui.pop_style_color()
    imgui.pop_font()
    tooltip(text)
    return pressed


def _outline(leak: float) -> str:
    return "Its outline moves." if leak > 0 else "Its outline stays, exactly."
