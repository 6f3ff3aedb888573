from functools import partial

from imgui_bundle import ImVec2, imgui

from tests.viewer.driver import Driver, in_window
from viewer.services.messages import Button, MessageKind


@in_window()
def test_two_errors_at_a_time_are_shown_and_all_are_in_the_log(window: Driver) -> None:
    messages = window.session.messages
    for number in range(4):
        messages.notify(f"wrong {number}", MessageKind.PROBLEM)
    window.ctx.yield_(3)
    assert window.exists("Messages/###dismiss 1")
    assert not window.exists("Messages/###dismiss 2")
    low, high = window.context.view
    box = window.ctx.window_info("//Messages").window
    assert low.x < box.pos.x
    end = box.pos + box.size
    assert end.x <= high.x and end.y <= high.y - window.context.covered  # not over the history
    assert box.size.y < 0.2 * (high.y - low.y)
    window.menu("Panels/Developer")
    window.ctx.yield_(3)
    assert window.ctx.window_info("//Developer").window.active
    assert [message.text for message in messages.log][-4:] == [f"wrong {number}" for number in range(4)]


@in_window()
def test_a_menu_and_the_question_for_a_file_are_drawn_over_messages(window: Driver) -> None:
    def is_above_messages() -> bool:
        window.ctx.yield_(3)
        popup = imgui.get_current_context().nav_window.root_window
        place = imgui.internal.find_window_display_index
        return place(popup) > place(window.ctx.window_info("//Messages").window)

    window.session.messages.notify("wrong", MessageKind.PROBLEM)
    window.click("View/###mode")
    assert is_above_messages()
    window.press(imgui.Key.escape)
    window.menu("File/###open_scene")
    assert window.context.files.asking and is_above_messages()
    window.press(imgui.Key.escape)


def _tooltip(window: Driver) -> imgui.internal.Window | None:
    box = window.ctx.window_info("//##Tooltip_00", imgui.test_engine.TestOpFlags_.no_error).window
    return box if box is not None and box.active and not box.hidden else None


@in_window()
def test_a_tooltip_covers_neither_its_button_nor_what_follows(window: Driver) -> None:
    window.context.share()
    window.ctx.yield_(3)
    window.ctx.mouse_move("//Share/###page")
    window.wait(lambda: _tooltip(window) is not None)
    box = _tooltip(window)
    assert box.pos.y + box.size.y <= window.ctx.item_info("//Share/###page").rect_full.min.y
    assert box.pos.x >= 0 and box.pos.x + box.size.x <= imgui.get_main_viewport().size.x


@in_window()
def test_no_tooltip_covers_a_message(window: Driver) -> None:
    window.session.messages.notify("wrong " * 60, MessageKind.PROBLEM)
    window.ctx.yield_(3)
    window.ctx.mouse_move("//Messages/###dismiss 0")
    window.wait(lambda: _tooltip(window) is not None)
    box = _tooltip(window)
    messages = window.ctx.window_info("//Messages").window
    assert box.pos.y + box.size.y <= messages.pos.y


@in_window()
def test_a_second_message_moves_no_button(window: Driver) -> None:
    messages = window.session.messages
    messages.notify("An object is ready", buttons=(Button("Show", lambda: None),))
    window.ctx.yield_(3)
    before = window.ctx.item_info("//Messages/###show 0").rect_full
    messages.notify("Another thing, told in a much longer line than the first one was", MessageKind.NOTE)
    window.ctx.yield_(3)
    after = window.ctx.item_info("//Messages/###show 0").rect_full
    assert (after.min.x, after.min.y) == (before.min.x, before.min.y)


@in_window()
def test_esc_closes_what_is_on_top(window: Driver) -> None:
    context = window.context
    window.press(imgui.Key.f1)
    window.click("View/###mode")
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


@in_window()
def test_results_are_told_apart_and_no_button_moves_under_the_mouse(window: Driver) -> None:
    messages = window.session.messages
    pressed = list[str]()
    relevant = {"red": True, "blue": True}
    for name in relevant:
        show = Button("Show", partial(pressed.append, name), name)
        messages.notify(f"Fitted: {name}", buttons=(show,), relevant=partial(relevant.__getitem__, name))
    window.ctx.yield_(3)
    red, blue = (window.ctx.item_info(f"//Messages/###show {number}").rect_full for number in range(2))
    assert blue.get_width() > red.get_width(), "each has the name of its object"
    window.ctx.mouse_move_to_pos(blue.get_center())
    relevant["red"] = False  # it was shown by a click on its tile
    for number in range(4):
        messages.notify(f"More {number}", buttons=(Button("OK", lambda: None),))
    window.ctx.yield_(3)
    window.ctx.mouse_click(0)
    assert pressed == ["blue"]
    window.ctx.yield_(3)
    window.ctx.mouse_click(0)
    assert pressed == ["blue"], "nothing took the place of the button"
    window.ctx.mouse_move_to_pos(ImVec2(5, 5))
    window.ctx.yield_(3)
    assert window.exists("Messages/###ok 2") and not window.exists("Messages/###ok 3"), "three at a time"
