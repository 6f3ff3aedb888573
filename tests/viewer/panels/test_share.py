import base64
import io
import re
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
import torch
import trimesh
from imgui_bundle import imgui
from PIL import Image

from core.edits.paint import PartPaint
from core.export.page import PageExtras
from core.metrics import psnr
from core.models.field import Field
from core.models.missing import MissingInstance
from core.models.model import Model
from core.models.scene import Scene, save_image
from core.runtime.files import atomic_file
from tests.conftest import image_size
from tests.viewer.driver import Drive, Driver, in_window
from tests.viewer.stand_ins import HeldFit
from viewer.services.backend import Backend


def filled(model: Model, bias: float) -> Model:
    """Clear air, or a solid block: both are drawn quickly."""
    field = Field(model.field.config)
    torch.nn.init.constant_(field.density_layer.bias, bias)
    return replace(model, field=field)


@pytest.fixture
def block(real_backend: Backend, model: Model) -> Backend:
    """Nothing stands in but a model of solid blocks."""
    solid = filled(model, 100.0)
    return replace(real_backend, load_model=lambda name: solid)


def choose(window: Driver, name: str, label: str) -> None:
    """An entry of one of the dialog's lists."""
    window.click(f"Share/{name}")
    window.click(f"**/{label}")


@in_window()
def test_files_are_saved_in_one_click_beside_the_last_one(window: Driver, tmp_path: Path) -> None:
    window.context.files.saves = tmp_path
    window.press(imgui.Key.mod_ctrl, imgui.Key.e)
    window.click("Share/###picture")
    for count in (1, 2):
        window.click("Share/###save here")
        window.wait(lambda count=count: len(list(tmp_path.iterdir())) == count and not window.session.exporting.running)
    window.press(imgui.Key.enter)
    window.wait(lambda: len(list(tmp_path.iterdir())) == 3 and not window.session.exporting.running)
    names = sorted(path.stem for path in tmp_path.glob("*.png"))
    assert names[1] == f"{names[0]}-2" and names[0].endswith("-picture")


def test_share_keeps_its_object_when_a_fit_ends(drive: Drive, backend: Backend, photo: Path) -> None:
    fit = HeldFit()

    def act(window: Driver) -> None:
        shared = window.editor.scene.instance
        window.context.drop([str(photo)])
        window.wait(lambda: bool(window.fitting.history.steps))
        window.press(imgui.Key.mod_ctrl, imgui.Key.e)
        fit.may_end.set()
        window.wait(lambda: not window.fitting.running)
        assert window.editor.objects.own == ["block"]
        assert window.editor.scene.instance is shared

    drive(act, replace(backend, fit=fit))


@in_window("block")
def test_a_page_is_saved_in_four_actions_and_begins_like_its_preview(window: Driver, tmp_path: Path) -> None:
    exporting = window.session.exporting
    window.drag("View/orbit", 90, -20)
    window.press(imgui.Key.mod_ctrl, imgui.Key.e)  # 1
    window.click("Share/###page")  # 2
    window.wait(lambda: exporting.preview.image is not None and not exporting.preview.stale)
    preview = Image.fromarray(exporting.preview.image)
    assert not window.exists("Share/###small") and not window.exists("Share/###more")
    window.click("Share/###save")  # 3
    window.type(str(tmp_path / "block"))  # 4
    window.wait(lambda: (tmp_path / "block.html").exists() and not exporting.running)
    assert window.session.messages.errors == []
    poster = re.search(r'src="data:image/webp;base64,([^"]*)"', (tmp_path / "block.html").read_text())
    assert poster is not None
    with Image.open(io.BytesIO(base64.b64decode(poster[1]))) as image:
        first = np.asarray(image.convert("RGBA").resize(preview.size)) / 255
    pixels = np.asarray(preview) / 255
    assert pixels[..., 3].mean() > 0.2
    assert psnr(first[..., 3], pixels[..., 3]) > 25  # colours of an untrained network are not the same when baked


def test_a_seat_in_five_colours_is_a_page_of_swatches_in_four_actions(drive: Drive, backend: Backend, tmp_path: Path):
    pages: list[PageExtras] = []

    def page(*arguments: Any) -> Iterator[None]:
        pages.append(arguments[-1])
        yield None

    def act(window: Driver) -> None:
        editor = window.editor
        window.context.files.saves = tmp_path
        plain = editor.scene.instance
        for number in range(5):
            editor.edit(plain.with_edits(PartPaint, PartPaint("seat", (0.2 * number, 0.1, 0.1), (0.5, 0.5, 0.5))))
        window.press(imgui.Key.mod_ctrl, imgui.Key.e)  # 1
        window.click("Share/###page")  # 2
        window.click("Share/###versions")  # 3
        window.click("Share/###save here")  # 4
        window.wait(lambda: bool(pages) and not window.session.exporting.running)
        assert len(pages[0].variants) == 6 and plain in pages[0].variants.values()
        assert (pages[0].unit, pages[0].room) == ("", False)
        window.click("Share/###room")
        choose(window, "##unit", "Centimetres")
        window.click("Share/###save here")
        window.wait(lambda: len(pages) == 2)
        assert (pages[1].unit, pages[1].room) == ("cm", True)
        window.click("Share/###mesh")
        window.click("Share/###usdz")
        assert window.context.preferences.share.mesh == ".usdz"
        assert not window.exists("Share/###versions")

    drive(act, replace(backend, page=page))


def test_a_turntable_is_saved_and_its_folder_shown(drive: Drive, tmp_path: Path, real_backend: Backend, model: Model):
    folders: list[Path] = []

    def act(window: Driver) -> None:
        exporting = window.session.exporting
        window.context.file_manager = folders.append
        window.click("View/###share")
        window.click("Share/###film")
        window.click("Share/###small")
        window.click("Share/###save")
        window.type(str(tmp_path / "turn.mp4"))
        window.wait(lambda: exporting.progress > 0, 60)
        window.wait(lambda: not exporting.running, 60)
        assert window.session.messages.errors == []
        with av.open(str(tmp_path / "turn.mp4")) as video:
            assert (video.streams.video[0].frames, video.streams.video[0].width) == (72, 256)
        window.click("Share/###show in folder")
        assert folders == [tmp_path / "turn.mp4"]
        window.press(imgui.Key.escape)
        assert not window.context.share_open

    air = filled(model, -100.0)
    drive(act, replace(real_backend, load_model=lambda name: air))


@in_window("block")
def test_the_preview_is_the_first_frame(window: Driver) -> None:
    editor = window.editor
    camera = editor.scene.camera
    editor.set_camera(replace(camera, distance=0.6 * camera.distance))
    window.context.share("turntable")
    preview = window.session.exporting.preview
    window.wait(lambda: preview.image is not None)
    opacity = preview.image[..., 3]
    assert opacity[[0, -1]].max() < 40 < opacity.mean() - 40  # all but the end of its shadow is in sight


@in_window("block")
def test_an_image_has_the_chosen_background(window: Driver, tmp_path: Path) -> None:
    def saved(name: str) -> Image.Image:
        window.click("Share/###save")
        window.type(str(tmp_path / name))
        window.wait(lambda: (tmp_path / name).exists() and not window.session.exporting.running)
        return Image.open(tmp_path / name)

    editor = window.editor
    editor.set_camera(replace(editor.scene.camera, distance=0.6 * editor.scene.camera.distance))
    window.press(imgui.Key.mod_ctrl, imgui.Key.e)
    window.click("Share/###picture")
    window.click("Share/###more")
    choose(window, "##background", "Colour")
    window.context.set_preference(share=replace(window.context.preferences.share, colour=(200, 10, 20)))
    window.click("Share/###small")
    with saved("red.png") as image:
        assert image.getpixel((0, 0)) == (200, 10, 20)
        assert image.size == (256, 256)
        pixels = np.asarray(image).astype(int)
    rows = np.flatnonzero((np.abs(pixels - (200, 10, 20)).sum(-1) > 60).any(1))
    assert 240 <= rows[-1] < 255  # down to the frame's edge, and no further
    choose(window, "##background", "Transparent")
    with saved("clear.png") as image:
        assert image.mode == "RGBA"
        assert image.getpixel((0, 0))[3] == 0
    choose(window, "##background", "As in the view")
    with saved("view.png") as image:
        for row, colour in ((0, window.context.palette.background[0]), (255, window.context.palette.background[1])):
            assert np.abs(np.array(image.getpixel((0, row))) / 255 - colour).max() < 0.02
    choose(window, "##picture", ".jpg")
    assert window.context.preferences.share.behind == (255, 255, 255)  # it cannot be transparent
    assert window.session.messages.errors == []


def test_a_mesh_is_saved(drive: Drive, tmp_path: Path, backend: Backend, model: Model) -> None:
    def act(window: Driver) -> None:
        window.context.share("mesh")
        window.click("Share/###more")
        choose(window, "##mesh", ".ply")
        choose(window, "##cells", "96 cells")
        assert window.context.preferences.share.cells == 96
        window.context.set_preference(share=replace(window.context.preferences.share, cells=24))
        window.click("Share/###save")
        window.type(str(tmp_path / "block"))
        window.wait(lambda: window.session.exporting.progress > 0)
        window.wait(lambda: not window.session.exporting.running)
        assert window.session.messages.errors == []
        mesh = trimesh.load_mesh(tmp_path / "block.ply")
        assert mesh.is_watertight
        np.testing.assert_allclose(mesh.extents / mesh.extents.max(), np.array(model.extent) / 0.45, rtol=0.05)
        assert (mesh.extents.max(), mesh.bounds[0, 2]) == pytest.approx((0.9, 0.0), abs=1e-5)
        assert mesh.visual.kind == "vertex"
        assert [path.name for path in tmp_path.iterdir()] == ["block.ply"]
        choose(window, "##mesh", ".glb")
        choose(window, "##texture", "Image, 512 px")
        assert window.context.preferences.share.texture == 512
        window.context.set_preference(share=replace(window.context.preferences.share, texture=64))
        window.click("Share/###save")
        window.type(str(tmp_path / "block.glb"))
        window.wait(lambda: (tmp_path / "block.glb").exists() and not window.session.exporting.running)
        (read,) = trimesh.load_scene(tmp_path / "block.glb").geometry.values()
        assert (read.extents.max(), read.bounds[0, 1]) == pytest.approx((0.9, 0.0), abs=1e-5)
        assert read.visual.material.baseColorTexture.width > 48

    block = filled(model, 100.0)
    drive(act, replace(backend, load_model=lambda name: block))


@pytest.mark.parametrize("closed", [False, True])
def test_a_cancelled_export_leaves_no_file(drive: Drive, tmp_path: Path, backend: Backend, closed: bool) -> None:
    def slow(*_: object) -> Iterator[float]:
        with atomic_file(tmp_path / "chair.glb"):
            for number in range(1000):
                time.sleep(0.01)
                yield number / 1000

    def act(window: Driver) -> None:
        session = window.session
        window.context.share("mesh")
        window.click("Share/###save")
        window.type(str(tmp_path / "chair.glb"))
        window.wait(lambda: session.exporting.progress > 0)
        assert len(list(tmp_path.iterdir())) == 1
        if closed:  # it goes on, and ends in the title row
            window.press(imgui.Key.escape)
            assert not window.context.share_open
        window.click(f"{'##MainMenuBar/##MenuBar' if closed else 'Share'}/###cancel export")
        window.wait(lambda: not list(tmp_path.iterdir()))
        assert not session.exporting.running
        assert session.messages.errors == []

    drive(act, replace(backend, mesh=slow))


@in_window()
def test_an_image_is_saved_with_the_settings_of_the_click(window: Driver, tmp_path: Path) -> None:
    window.menu("File/###share")
    window.click("Share/###picture")
    window.click("Share/###save")
    window.context.set_preference(share=replace(window.context.preferences.share, size=128))  # too late
    window.type(str(tmp_path / "mine"))
    window.wait()
    assert image_size(tmp_path / "mine.png") == (512, 512)


@in_window()
def test_a_dropped_image_of_this_program_restores_its_scene(
    window: Driver, tmp_path: Path, model: Model, photo: Path
) -> None:
    foreign = Scene(MissingInstance("another", model.codes[0]), model.camera(0, 0))
    save_image(np.zeros((32, 32, 3), np.uint8), tmp_path / "other.png", foreign)
    editor = window.editor
    window.drag("View/orbit", 90, -20)
    window.press(imgui.Key.r)
    scene = editor.scene
    window.context.share("picture")
    window.click("Share/###save")
    window.type(str(tmp_path / "mine.png"))
    window.wait()
    window.context.share_open = False
    window.click("View/###reset_view")
    window.click("Library/**/show object 4")
    window.context.drop([str(tmp_path / "mine.png")])
    assert editor.scene == scene
    history = editor.history
    window.context.drop([str(tmp_path / "other.png")])
    window.wait(lambda: bool(window.session.messages.errors))
    assert "a model that is not open" in window.session.messages.errors[0]
    assert editor.history is history
    assert not window.session.fitting.running
    assert editor.objects.own == ["mine"]
    editor.show_object("object 4")
    window.context.drop([str(tmp_path / "mine.png"), str(photo)])  # both are taken
    assert editor.scene == scene
    window.wait(lambda: "block" in editor.objects.own)
