"""The table of all actions: source of menus, keys, help, tooltips and the README's table."""

import re
from collections.abc import Callable
from dataclasses import dataclass

from imgui_bundle import imgui  # before glfw, so that both use the same library

import glfw  # isort: skip

from viewer.context import PanelContext
from viewer.values.preferences import LARGEST, SMALLEST

Test = Callable[[PanelContext], bool]


@dataclass(frozen=True)
class Action:
    """An action with a key, a menu entry or a button."""

    id: str
    words: str  # label in menus
    keys: str  # chords, such as ``Ctrl+Y, Ctrl+Shift+Z``; empty for none
    tooltip: str  # the effect, also in the help

    def run(self, context: PanelContext) -> None:
        """Run the action."""
        _RUN[self.id](context)

    def enabled(self, context: PanelContext) -> bool:
        """True if the action can be run now."""
        return self.id not in _ENABLED or _ENABLED[self.id](context)

    def hint(self) -> str:
        """Return the tooltip of the action's button: effect and keys."""
        return f"{self.tooltip} ({self.keys})" if self.keys else self.tooltip


@dataclass(frozen=True)
class Gesture:
    """A use of the mouse or the keyboard in one panel, listed in the help."""

    words: str
    tooltip: str  # the effect


TABLE: dict[str, tuple[Action | Gesture, ...]] = {
    "View": (
        Gesture("Drag, or arrow keys", "turn the object; finer with Shift"),
        Gesture("Wheel, or + and -", "zoom"),
        Gesture("Click a part", "it lights up: its handle makes the object taller or wider, its name has its colours"),
        Gesture("Middle or right drag", "pan: move the object in the view"),
        Gesture("Double click", "the first view again: its photo's camera, if the object has a photo"),
        Action("reset_view", "Reset view", "0", "the first view again: its photo's camera, if the object has a photo"),
        Action("see_front", "Front", "1", "see the object from the front"),
        Action("see_side", "Side", "2", "see the object from the side"),
        Action("see_top", "Top", "3", "see the object from the top"),
        Action("see_photo", "Photo", "4", "the photo over the object, to compare; again: without the photo"),
        Action("fold_panels", "Fold panels", "", "hide or show all panels"),
    ),
    "Library": (
        Gesture("Click", "show the object: it becomes A"),
        Gesture("Click the number", "show or hide the variants of a form"),
        Gesture("Click a small tile", "show that version of the object above: as fitted, or as an edit left it"),
        Gesture("Right click", "make it B; keep this version, rename, remove"),
        Gesture("Drag onto B", "mix the object with the one in the view"),
        Gesture("Arrow keys, Enter", "move between tiles, and show the object"),
    ),
    "Mix": (Gesture("Drag in the pad", "to the right the shape of B, upwards its texture"),),
    "Sliders": (
        Action("sample", "Random", "R", "a random shape and texture"),
        Action("reset", "Reset", "", "the object without its edits"),
        Gesture("Hover over a slider", "see the result, and the pixels that change"),
        Gesture("Size", "drag or type width, depth, height, legs or roof in cm; a button shows a box to drag"),
        Gesture("Ctrl+click", "type a value"),
    ),
    "History": (
        Gesture("Click a thumbnail", "go to that state; turning the view there keeps the later ones"),
        Gesture("Click a small thumbnail", "go to another branch: what an edit of an earlier state left behind"),
    ),
    "Photo": (
        Action("fit_image", "Open photo…", "Ctrl+I", "choose a photo or a video of one object, and fit it"),
        Action("paste", "Paste photo", "Ctrl+V", "fit the photo in the clipboard"),
        Gesture("Click a grey tile", "in Mine and History: find the file of a missing model"),
        Gesture("Click a photo under way", "in Mine: watch its fit from the photo's camera"),
        Gesture("Click a numbered box", "fit this one of several objects"),
        Gesture("Compare", "drag in the view: the photo on the left, the render on the right"),
        Gesture("Erase", "drag over a reflection, for example, to remove it; the wheel sets the brush size"),
        Gesture("Swatch", "paint the chosen part; drag in the square of colours for any other"),
        Gesture("Eyedropper", "pick the paint from the photo or the view"),
        Gesture("Photo detail", "a slider: how much of the photo's outline and lettering the object shows"),
        Gesture("Click a candidate", "in Developer: continue the search from this one alone"),
        Gesture("Try again", "fit again: from the beginning, from this view, as another category"),
    ),
    "Cut out": (
        Gesture("Click", "choose the object there; with Shift, add another part of it"),
        Gesture("Drag", "a box around the object, or strokes that add or remove"),
        Gesture("Wheel, middle drag", "zoom and move the photo"),
        Gesture("Ctrl+Z", "undo the last click, box or stroke"),
    ),
    "Files": (
        Gesture("Drop a photo", "fit the object in it"),
        Gesture("Drop a video", "fit the object that it walks around"),
        Gesture("Drop several, or a folder", "up to twelve photos of one object; a button makes them an object each"),
        Gesture("Drop an image saved here", "a png restores its shape, texture and camera"),
        Gesture("Drop a project", "open everything that it holds"),
        Action("new_project", "New", "Ctrl+N", "start afresh; fitted objects stay in Mine"),
        Action("open_scene", "Open…", "Ctrl+O", "open a photo, a video, a project, an image saved here, or a model"),
        Action("save_project", "Save project", "Ctrl+S", "save everything in one file"),
        Action("save_project_as", "Save project as…", "Ctrl+Shift+S", "save everything in another file"),
        Action("share", "Share…", "Ctrl+E", "save a page, a film, a picture or a mesh"),
        Action("copy_image", "Copy image", "Ctrl+C", "copy the view on white, without its shadow"),
    ),
    "Everywhere": (
        Action("undo", "Undo", "Ctrl+Z", "undo the last edit; a drag is one step"),
        Action("redo", "Redo", "Ctrl+Y, Ctrl+Shift+Z", "redo the undone edit"),
        Action("larger_text", "Larger text", "Ctrl++", "larger text"),
        Action("smaller_text", "Smaller text", "Ctrl+-", "smaller text"),
        Action("dark", "Dark or light", "", "dark or light colours"),
        Action("reset_layout", "Reset layout", "", "the panels as at first"),
        Gesture("Esc", "undo the drag, or close what is on top: a menu, a dialog, the help"),
        Gesture("Tab, arrow keys", "move between controls; Space presses one, and Ctrl+Tab goes to the next panel"),
        Action("help", "Keys and search…", "Ctrl+K, F1, ?", "search keyboard shortcuts, panels and objects"),
        Action("quit", "Quit", "Ctrl+Q", "end the program"),
    ),
}  # rows by place, in the order of the help

ACTIONS: dict[str, Action] = {row.id: row for rows in TABLE.values() for row in rows if isinstance(row, Action)}


_RUN: dict[str, Callable[[PanelContext], object]] = {
    "reset_view": lambda c: c.session.viewport.reset_view(),
    "see_front": lambda c: c.session.see_from("front"),
    "see_side": lambda c: c.session.see_from("side"),
    "see_top": lambda c: c.session.see_from("top"),
    "see_photo": lambda c: c.see_photo(),
    "fold_panels": lambda c: c.fold_panels(),
    "sample": lambda c: c.session.editor.sample(),
    "reset": lambda c: c.session.editor.reset(),
    "fit_image": lambda c: c.fit_image(),
    "paste": lambda c: c.paste(),
    "new_project": lambda c: c.session.new(),
    "open_scene": lambda c: c.open_file(),
    "save_project": lambda c: c.save_project(),
    "save_project_as": lambda c: c.save_project_as(),
    "share": lambda c: c.share(),
    "copy_image": lambda c: c.copy_image(),
    "undo": lambda c: c.session.editor.undo(),
    "redo": lambda c: c.session.editor.redo(),
    "larger_text": lambda c: c.resize_text(1),
    "smaller_text": lambda c: c.resize_text(-1),
    "dark": lambda c: c.set_preference(dark=not c.preferences.dark),
    "reset_layout": lambda c: c.reset_layout(),
    "help": lambda c: setattr(c, "help_open", not c.help_open),
    "quit": lambda c: c.quit(),
}
_ENABLED: dict[str, Test] = {
    "see_photo": lambda c: c.session.photo_view is not None,
    "reset": lambda c: c.session.editor.scene.instance != c.session.editor.original,
    "copy_image": lambda c: c.session.viewport.frame is not None and c.session.viewport.baked_frame is None,
    "undo": lambda c: bool(c.session.editor.history.past),
    "redo": lambda c: bool(c.session.editor.history.future),
    "larger_text": lambda c: c.preferences.text < LARGEST,
    "smaller_text": lambda c: c.preferences.text > SMALLEST,
}


def run_keys(context: PanelContext) -> None:
    """Run the actions whose keys are pressed. Call once a frame.

    While text is typed into a field, no key runs an action.
    """
    if imgui.get_io().want_text_input:
        return
    typing = context.files.asking or context.share_open
    for action in ACTIONS.values():
        keys = ", ".join(key for key in action.keys.split(", ") if not typing or "Ctrl" in key or key == "F1")
        pressed = any(map(is_pressed, chords(keys))) or any(map(is_typed, keys.split(", ")))
        # The segmentation dialog has its own keys and would hide the help.
        allowed = not context.session.segmenting.active or action.id in ("quit", "larger_text", "smaller_text")
        if pressed and allowed and action.enabled(context):
            action.run(context)


def is_pressed(chord: int) -> bool:
    """Return whether a chord is pressed or repeated in this frame.

    A modifier that is released in the same frame counts as held: imgui does not order the events of a frame, and in a
    slow one would take ``Ctrl+R`` for ``R``.
    """
    held = sum(int(key) for key in _EVERY_MODIFIER if imgui.is_key_down(key) or imgui.is_key_released(key))
    mods = chord & sum(map(int, _EVERY_MODIFIER))
    return held == mods and imgui.is_key_pressed(imgui.Key(chord - mods))


def is_typed(text: str) -> bool:
    """Return whether a chord of a sign, ``?`` or ``Ctrl++``, is pressed by other keys than those of :func:`chords`.

    A key alone counts by the sign that it types; with Ctrl, which types nothing, by the sign that it prints.
    """
    held = text[:-1]
    sign = text[-1:]
    if sign.isalnum() or not sign:
        return False
    if held:
        modifiers = [_MODIFIERS[name] for name in held.split("+")[:-1]]
        return any(is_pressed(chord(*modifiers, key)) for key in _printing(sign))
    keys = [imgui.Key(number & ~chord(*_EVERY_MODIFIER)) for number in chords(sign)]
    return ord(sign) in imgui.get_io().input_queue_characters and not any(map(imgui.is_key_down, keys))


def chords(keys: str) -> list[int]:
    """Return imgui's numbers of key chords, such as ``Ctrl++``: =, Shift+= and the keypad's +."""
    return [sum(chord) for text in keys.split(", ") if text for chord in _chord(text)]


def chord(*keys: imgui.Key) -> int:
    """Return imgui's number of keys pressed together (older Pythons cannot join keys by ``|``)."""
    return sum(map(int, keys))


def _chord(text: str) -> list[tuple[int, ...]]:
    *modifiers, name = re.sub(r"(^|\+)\+$", r"\1plus", text).split("+")
    held = tuple(int(_MODIFIERS[modifier]) for modifier in modifiers)
    return [(*held, *map(int, keys)) for keys in _key(name)]


def _key(name: str) -> list[tuple[imgui.Key, ...]]:
    key = imgui.Key
    if name in _NAMED:
        return _NAMED[name]
    if name.isdigit():
        return [(getattr(key, f"_{name}"),), (getattr(key, f"keypad{name}"),)]
    return [(getattr(key, name.lower()),)]


def _printing(sign: str) -> list[imgui.Key]:
    """Return the keys that print a sign without Shift on this keyboard; imgui names them by their US signs."""
    names = [name for name in _SIGN_KEYS if glfw.get_key_name(getattr(glfw, f"KEY_{name.upper()}"), 0) == sign]
    return [getattr(imgui.Key, name) for name in names]


_SIGN_KEYS = (
    *("apostrophe", "comma", "minus", "period", "slash", "semicolon", "equal", "left_bracket", "backslash"),
    *("right_bracket", "grave_accent"),
)  # as imgui and GLFW name them
_EVERY_MODIFIER = imgui.Key.mod_ctrl, imgui.Key.mod_shift, imgui.Key.mod_alt, imgui.Key.mod_super
_MODIFIERS = {"Ctrl": imgui.Key.mod_ctrl, "Shift": imgui.Key.mod_shift}
_NAMED: dict[str, list[tuple[imgui.Key, ...]]] = {
    "plus": [(imgui.Key.equal,), (imgui.Key.mod_shift, imgui.Key.equal), (imgui.Key.keypad_add,)],
    "-": [(imgui.Key.minus,), (imgui.Key.keypad_subtract,)],
    "?": [(imgui.Key.mod_shift, imgui.Key.slash)],
}
