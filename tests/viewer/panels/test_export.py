import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import av
import numpy as np
import pytest
import torch
import trimesh
from imgui_bundle import imgui

from core.files import atomic_file
from core.models.field import Field
from core.models.model import Model
from core.models.scene import Scene, save_image
from tests.conftest import image_size
from tests.viewer.driver import Drive, Driver
from viewer.panels.export import ExportPanel
from viewer.services.backend import Backend


def filled(model: Model, bias: float) -> Model:
    """Clear air, or a solid block: both are drawn quickly."""
    field = Field(model.field.config)
    torch.nn.init.constant_(field.density_layer.bias, bias)
    return replace(model, field=field)


def test_a_turntable_is_exported(drive: Drive, tmp_path: Path, real_backend: Backend, model: Model) -> None:
    def act(window: Driver) -> None:
        session, workspace = window.session, window.workspace
        window.show("Export")
        window.click("Export/##video size")
        window.click("**/128 px")
        window.click("Export/##frames")
        window.click("**/36 frames")
        window.click("Export/###export turntable")
        window.type(str(tmp_path / "turn.mp4"))
        window.wait(lambda: workspace.exporting.progress > 0, 60)
        window.wait(lambda: not workspace.exporting.running, 60)
        assert session.messages.errors == []
        with av.open(str(tmp_path / "turn.mp4")) as video:
            assert (video.streams.video[0].frames, video.streams.video[0].width) == (36, 128)

    air = filled(model, -100.0)
    drive(act, replace(real_backend, load_model=lambda name: air))


def test_a_mesh_is_exported(drive: Drive, tmp_path: Path, backend: Backend, model: Model) -> None:
    def act(window: Driver) -> None:
        session, workspace = window.session, window.workspace
        window.show("Export")
        window.click("Export/##mesh format")
        window.click("**/.ply")
        window.click("Export/##cells")
        window.click("**/96 cells")
        window.click("Export/###export mesh")
        window.type(str(tmp_path / "block"))
        window.wait(lambda: workspace.exporting.progress > 0)
        window.wait(lambda: not workspace.exporting.running)
        assert session.messages.errors == []
        found = trimesh.load_mesh(tmp_path / "block.ply")
        assert found.is_watertight
        np.testing.assert_allclose(found.extents, 2 * np.array(model.extent), rtol=0.05)
        assert found.visual.kind == "vertex"
        assert [path.name for path in tmp_path.iterdir()] == ["block.ply"]

    block = filled(model, 100.0)
    drive(act, replace(backend, load_model=lambda name: block))


@pytest.mark.parametrize(("kind", "name"), [("turntable", "turn.mp4"), ("mesh", "chair.glb")])
def test_an_export_is_cancelled_and_leaves_nothing(
    drive: Drive, tmp_path: Path, backend: Backend, kind: str, name: str
) -> None:
    def slow(*_: object) -> Iterator[float]:
        with atomic_file(tmp_path / name):
            for number in range(1000):
                time.sleep(0.01)
                yield number / 1000

    def act(window: Driver) -> None:
        session, workspace = window.session, window.workspace
        window.show("Export")
        window.click(f"Export/###export {kind}")
        window.type(str(tmp_path / name))
        window.wait(lambda: workspace.exporting.progress > 0)
        assert len(list(tmp_path.iterdir())) == 1
        window.click("Export/###cancel export")
        window.wait(lambda: not list(tmp_path.iterdir()))
        assert not workspace.exporting.running
        assert session.messages.errors == []

    drive(act, replace(backend, video=slow, mesh=slow))


def test_scenes_and_images_are_saved_and_opened(drive: Drive, tmp_path: Path) -> None:
    def act(window: Driver) -> None:
        editor = window.workspace.editor
        window.drag("View/orbit", 90, -20)
        scene = editor.scene
        window.show("Export")
        window.click("Export/###save_scene")
        window.type(str(tmp_path / "mine"))
        assert (tmp_path / "mine.json").is_file()
        window.click("Export/###save image")
        export = next(panel for panel in window.app.panels if isinstance(panel, ExportPanel))
        export.image_size = 128  # too late: what stood there at the click counts
        window.type(str(tmp_path / "mine"))
        window.wait()
        assert image_size(tmp_path / "mine.png") == (512, 512)
        window.click("View/###reset_view")
        assert editor.scene != scene
        window.press(imgui.Key.mod_ctrl, imgui.Key.o)
        window.type(str(tmp_path / "mine.json"))
        assert editor.scene == scene
        window.click("View/###reset_view")
        window.context.drop([str(tmp_path / "mine.json")])
        assert editor.scene == scene
        window.press(imgui.Key.mod_ctrl, imgui.Key.s)
        window.ctx.item_click("//Choose a file###ask/Cancel")
        window.ctx.yield_(2)
        assert not window.context.files.asking

    drive(act)


def test_a_dropped_image_of_this_program_restores_its_scene(
    drive: Drive, tmp_path: Path, model: Model, photo: Path
) -> None:
    other = Scene("another model", model.codes[0], model.camera(0, 0))
    save_image(np.zeros((32, 32, 3), np.uint8), tmp_path / "other.png", other)

    def act(window: Driver) -> None:
        session, workspace, editor = window.session, window.workspace, window.workspace.editor
        window.drag("View/orbit", 90, -20)
        window.show("Sliders")
        window.click("Sliders/**/###Random shape")
        scene = editor.scene
        window.show("Export")
        window.click("Export/###save image")
        window.type(str(tmp_path / "mine.png"))
        window.wait()
        window.click("View/###reset_view")
        window.click("Library/**/show object 4")
        window.context.drop([str(tmp_path / "mine.png")])
        assert editor.scene == scene
        before = editor.history
        window.context.drop([str(tmp_path / "other.png")])
        window.wait(lambda: bool(session.messages.errors))
        assert "another model" in session.messages.errors[0]
        assert editor.history is before
        assert not workspace.fitting.running
        assert editor.objects.names == ["mine", *(f"object {number}" for number in range(6))]
        editor.show_object("object 4")
        window.context.drop([str(tmp_path / "mine.png"), str(photo)])  # both are taken
        assert editor.scene == scene
        window.wait(lambda: "block" in editor.objects.names)

    drive(act)
