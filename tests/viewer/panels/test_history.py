from pathlib import Path

from tests.viewer.driver import Drive, Driver


def test_a_click_in_the_history_restores_a_state(drive: Drive, tmp_path: Path) -> None:
    def act(window: Driver) -> None:
        editor = window.workspace.editor
        window.show("History")
        first = editor.state
        window.drag("View/orbit", 60)
        second = editor.state
        window.click("Library/**/show object 3")
        third = editor.state
        window.wait()
        window.click("History/**/state 1")
        assert editor.state == first
        assert len(editor.history.future) == 2
        window.click("History/**/state 3")
        assert editor.state == third
        window.click("History/**/state 2")
        assert editor.state == second
        window.redo()
        assert editor.state == third

    drive(act)
