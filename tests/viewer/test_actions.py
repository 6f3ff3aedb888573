from pathlib import Path

import pytest
from imgui_bundle import imgui

import glfw  # isort: skip
from tests.viewer.driver import Driver, in_window
from viewer import actions
from viewer.actions import ACTIONS, TABLE, Action, chord, chords


def markdown_table() -> str:
    lines = ["| where | keys and mouse | |", "|---|---|---|"]
    for panel, rows in TABLE.items():
        for number, row in enumerate(rows):
            keys = f"`{'`, `'.join(row.keys.split(', '))}`" if isinstance(row, Action) and row.keys else row.words
            lines.append(f"| {'' if number else f'**{panel}**'} | {keys} | {row.tooltip} |")
    return "\n".join(lines) + "\n"


def test_every_action_is_in_the_readme_and_every_key_once() -> None:
    readme = (Path(actions.__file__).parent / "README.md").read_text()
    assert markdown_table() == readme.split("<!-- actions -->\n")[1].split("<!-- end of actions -->")[0]
    rows = [row for rows in TABLE.values() for row in rows if isinstance(row, Action)]
    assert len(rows) == len(ACTIONS)
    pressed = [chord for row in rows for chord in chords(row.keys)]
    assert len(pressed) == len({*pressed})


_KEY = imgui.Key
_CTRL = _KEY.mod_ctrl


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ("", []),
        ("Home", [(_KEY.home,)]),
        ("K", [(_KEY.k,)]),
        ("1", [(_KEY._1,), (_KEY.keypad1,)]),
        ("F1, ?", [(_KEY.f1,), (_KEY.mod_shift, _KEY.slash)]),
        ("Ctrl+Y, Ctrl+Shift+Z", [(_CTRL, _KEY.y), (_CTRL, _KEY.mod_shift, _KEY.z)]),
        ("Ctrl++", [(_CTRL, _KEY.equal), (_CTRL, _KEY.mod_shift, _KEY.equal), (_CTRL, _KEY.keypad_add)]),
        ("Ctrl+-", [(_CTRL, _KEY.minus), (_CTRL, _KEY.keypad_subtract)]),
    ],
)
def test_keys_are_chords(keys: str, expected: list[tuple[imgui.Key, ...]]) -> None:
    assert chords(keys) == [chord(*pressed) for pressed in expected]


@in_window()
def test_signs_of_other_keyboards_zoom_search_and_scale_text(window: Driver, monkeypatch: pytest.MonkeyPatch) -> None:
    """On a German keyboard the key right of P prints +, and Shift with the key right of 0 prints ?."""
    window.wait_for_view()
    window.ctx.mouse_move("//View/orbit")
    distance = window.session.viewport.camera.distance
    window.ctx.key_chars("+")
    window.ctx.yield_(3)
    assert window.session.viewport.camera.distance < distance
    window.ctx.key_chars("?")
    window.ctx.yield_(3)
    assert window.context.help_open
    window.press(imgui.Key.escape)
    text = window.context.preferences.text
    monkeypatch.setattr(glfw, "get_key_name", lambda key, _: "+" if key == glfw.KEY_RIGHT_BRACKET else None)
    window.press(imgui.Key.mod_ctrl, imgui.Key.right_bracket)
    assert window.context.preferences.text > text


@in_window()
def test_a_sign_is_one_press_of_its_key(window: Driver) -> None:
    window.ctx.key_down(chord(imgui.Key.mod_shift, imgui.Key.slash))
    window.ctx.key_chars("?")
    window.ctx.yield_(3)
    window.ctx.key_up(chord(imgui.Key.mod_shift, imgui.Key.slash))
    window.ctx.yield_(3)
    assert window.context.help_open
