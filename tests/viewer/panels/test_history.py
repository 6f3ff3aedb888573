from pathlib import Path

from imgui_bundle import imgui

from tests.viewer.driver import Drive, Driver, in_window
from viewer.values.state import State


@in_window()
def test_a_click_in_the_history_brings_an_edit_back_and_each_object_has_one_tile(window: Driver) -> None:
    first = window.editor.state
    assert not window.exists("History/state 1")  # nothing was edited
    for step in (1, 2, 3):
        window.drag("View/orbit", 60)
        moved = window.editor.state
        window.click(f"Library/**/show object {step + 2}")
    last = window.editor.state
    assert len(window.editor.history.past) == 6  # undo has the moves too
    window.editor.mix_both(0.5, 0.5)
    mixed = window.editor.state
    window.wait()
    assert window.exists("History/state 5") and not window.exists("History/state 6")
    window.click("History/state 3")
    assert window.editor.state == moved
    assert window.exists("History/state 4") and not window.exists("History/state 5")  # the last object is folded
    window.click("History/state 1")
    assert window.editor.scene.instance == first.scene.instance
    window.click("History/state 4")
    assert window.editor.state == mixed
    window.press(imgui.Key.mod_ctrl, imgui.Key.z)
    assert window.editor.scene == last.scene


def test_an_edit_of_an_earlier_state_leaves_a_branch_that_is_saved_and_one_click_away(
    drive: Drive, tmp_path: Path
) -> None:
    def first(window: Driver) -> None:
        for number in (2, 3, 4):
            window.click(f"Library/**/show object {number}")
        window.wait()
        made.append(window.editor.state)
        window.click("History/state 2")
        window.press(imgui.Key.r)
        made.append(window.editor.state)
        assert not window.exists("History/state 4")
        window.session.save_project(tmp_path / "a.codenerf")
        look(window)

    def look(window: Driver) -> None:
        assert window.editor.state == made[1]
        window.click("History/branch 1")
        assert window.editor.state == made[0]
        assert window.exists("History/state 4")
        window.click("History/branch 1")  # now that of the other one
        assert window.editor.state == made[1]

    def second(window: Driver) -> None:
        look(window)
        window.menu("File/###new_project")
        window.session.open_project(tmp_path / "a.codenerf")
        window.wait()
        look(window)

    made: list[State] = []
    drive(first, folder=tmp_path / "config")
    drive(second, folder=tmp_path / "config")
