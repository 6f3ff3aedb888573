from imgui_bundle import imgui

from tests.viewer.driver import Drive, Driver


def test_a_click_in_the_history_brings_an_edit_back_and_moves_of_the_camera_fill_it_not(drive: Drive) -> None:
    def act(window: Driver) -> None:
        editor = window.session.editor
        first = editor.state
        for step in (1, 2, 3):
            window.drag("View/orbit", 60)
            moved = editor.state
            window.click(f"Library/**/show object {step + 2}")
            assert [at for at, _ in editor.history.edits] == [*range(1, 2 * step, 2), 2 * step]
        last = editor.state
        assert len(editor.history.past) == 6  # undo has the moves too
        assert editor.history.edits[-1][1] == "object 5"
        assert not window.exists("History/**/state 5")
        window.wait()
        window.click("History/**/state 3")
        assert editor.state == moved
        assert len(editor.history.future) == 1
        window.click("History/**/state 1")
        assert editor.scene.codes == first.scene.codes
        window.click("History/**/state 4")
        assert editor.state == last
        window.press(imgui.Key.mod_ctrl, imgui.Key.z)
        assert editor.state == moved

    drive(act)
