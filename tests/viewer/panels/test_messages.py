from functools import partial

import pytest
from imgui_bundle import ImVec2, imgui

from tests.viewer.driver import Driver, in_window, tooltip
from viewer.panels import messages as panel
from viewer.services.messages import OK, Button


@in_window()
def test_a_tooltip_covers_neither_its_button_nor_what_follows(window: Driver) -> None:
    window.context.share()
    window.ctx.yield_(3)
    window.ctx.mouse_move("//Share/###page")
    window.wait(lambda: tooltip(window) is not None)
    box = tooltip(window)
    assert box.pos.y + box.size.y <= window.ctx.item_info("//Share/###page").rect_full.min.y
    assert box.pos.x >= 0 and box.pos.x + box.size.x <= imgui.get_main_viewport().size.x


@in_window()
def test_esc_closes_what_is_on_top(window: Driver) -> None:
    context = window.context
    window.press(imgui.Key.f1)
    window.click("Library/**/show object 3", 1)
    assert imgui.is_popup_open("", imgui.PopupFlags_.any_popup)
    window.press(imgui.Key.escape)
    assert not imgui.is_popup_open("", imgui.PopupFlags_.any_popup)
    assert context.help_open
    window.press(imgui.Key.escape)
    assert not context.help_open
    window.menu("File/###open_scene")
    window.ctx.yield_(3)
    window.press(imgui.Key.escape)
    window.wait(lambda: not context.files.asking)


@in_window(size=(900, 600))
def test_the_newest_message_covers_nothing_and_nothing_changes_under_the_mouse(window: Driver) -> None:
    messages = window.session.messages
    pressed = list[str]()
    for name in ("red", "blue"):
        show = Button("Show", partial(pressed.append, name), name)
        messages.notify(f"Ready: {name}", buttons=(show,))
    window.ctx.yield_(3)
    show = window.ctx.item_info("//##MainMenuBar/##MenuBar/###show").rect_full
    assert show.max.y <= window.context.view[0].y
    window.ctx.mouse_move_to_pos(show.get_center())
    messages.notify("A longer word than that before, which would move the button" * 9, buttons=OK)
    window.ctx.yield_(3)
    window.ctx.mouse_click(0)
    window.ctx.mouse_click(0)
    assert pressed == ["blue"], "nothing took the place of the pressed button"
    window.ctx.mouse_move_to_pos(ImVec2(5, 300))
    window.ctx.yield_(3)
    button = window.ctx.item_info("//##MainMenuBar/##MenuBar/###ok").rect_full
    assert button.max.x < 900 and not window.exists("##MainMenuBar/##MenuBar/###show")
    window.click("##MainMenuBar/##MenuBar/###ok")
    window.ctx.yield_(3)
    assert not window.exists("##MainMenuBar/##MenuBar/###ok") and pressed == ["blue"]


@in_window(size=(900, 600))
def test_a_message_has_two_lines_before_it_is_shortened(window: Driver, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn = list[str]()
    shorten = panel.shortened

    def recorded(words: str, width: float) -> str:
        drawn.append(shorten(words, width))
        return drawn[-1]

    monkeypatch.setattr(panel, "shortened", recorded)
    text = "Cannot fit this image: grey16.png: the image is too large (19900x19900 px); make it smaller than 8192 px"
    window.session.messages.notify(text)
    window.ctx.yield_(3)
    assert drawn[-1] == text
