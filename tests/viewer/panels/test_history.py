from imgui_bundle import imgui

from tests.viewer.driver import Driver, in_window


@in_window()
def test_a_click_in_the_history_brings_an_edit_back_and_each_object_has_one_tile(window: Driver) -> None:
    editor = window.session.editor
    first = editor.state
    assert not window.exists("History/state 1")  # nothing was edited
    for step in (1, 2, 3):
        window.drag("View/orbit", 60)
        moved = editor.state
        window.click(f"Library/**/show object {step + 2}")
    last = editor.state
    assert len(editor.history.past) == 6  # undo has the moves too
    window.press(imgui.Key.k)
    editor.mix_both(0.5, 0.5)
    mixed = editor.state
    window.wait()
    assert window.exists("History/state 5") and not window.exists("History/state 6")
    window.click("History/state 3")
    assert editor.state == moved
    assert window.exists("History/state 4") and not window.exists("History/state 5")  # the last object is folded
    window.click("History/state 1")
    assert editor.scene.codes == first.scene.codes
    window.click("History/state 4")
    assert editor.state == mixed
    window.press(imgui.Key.mod_ctrl, imgui.Key.z)
    assert editor.scene == last.scene
