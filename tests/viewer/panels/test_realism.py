from tests.viewer.driver import Drive, Driver


def test_a_code_is_measured_and_brought_back(drive: Drive) -> None:
    def act(window: Driver) -> None:
        editor = window.session.editor
        window.show("Realism")
        window.click("Library/**/show object 3")
        assert [editor.nearest(part)[0] for part in ("shape", "texture")] == ["object 3", "object 3"]
        before, far = editor.state, editor.distance("shape")
        window.drag("Realism/**/##distance shape", -60)
        assert 0 < editor.distance("shape") < far
        assert editor.scene.codes.texture is before.scene.codes.texture
        window.undo()
        assert editor.state == before

    drive(act)
