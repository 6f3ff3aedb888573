import io
import struct
import zipfile
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from pxr import Usd, UsdGeom, UsdShade, UsdValidation

from core.editing.size import sized
from core.export.mesh import MeshSettings, export_mesh
from core.models.library import load_model
from tests.core.detail.test_maps import striped


@pytest.fixture(scope="module")
def chair(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("usdz") / "chair.usdz"
    instance = sized(load_model("chairs")[999], width=60.0, depth=58.0, height=92.0)
    list(export_mesh(instance, path, MeshSettings(64, texture=256)))
    return path


def test_members_of_a_usdz_are_uncompressed_and_aligned(chair: Path):
    data = chair.read_bytes()
    with zipfile.ZipFile(chair) as file:
        assert file.testzip() is None
        assert [Path(member.filename).suffix for member in file.infolist()] == [".usda", ".jpg"]
        for member in file.infolist():
            assert member.compress_type == zipfile.ZIP_STORED
            name, extra = struct.unpack_from("<HH", data, member.header_offset + 26)
            assert (member.header_offset + 30 + name + extra) % 64 == 0


def test_usds_own_checks_find_no_fault(chair: Path):
    stage = Usd.Stage.Open(str(chair))
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert len(validators) > 10
    errors = UsdValidation.ValidationContext(validators).Validate(stage)
    assert [error.GetErrorAsString() for error in errors] == []


def test_a_usdz_has_the_size_in_metres_on_the_floor_and_its_parts(chair: Path):
    stage = Usd.Stage.Open(str(chair))
    assert (UsdGeom.GetStageMetersPerUnit(stage), UsdGeom.GetStageUpAxis(stage)) == (1.0, "Y")
    root = stage.GetDefaultPrim()
    box = UsdGeom.BBoxCache(Usd.TimeCode.Default(), ["default"]).ComputeWorldBound(root).ComputeAlignedRange()
    np.testing.assert_allclose(box.GetSize(), (0.600, 0.920, 0.580), atol=1e-4)
    np.testing.assert_allclose(box.GetMidpoint(), (0, 0.460, 0), atol=1e-4)
    meshes = [prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    assert {"seat", "back", "legs"} <= {mesh.GetName() for mesh in meshes}
    for mesh in meshes:
        material, _ = UsdShade.MaterialBindingAPI(mesh).ComputeBoundMaterial()
        assert material.GetPath() == "/object/colours"


def test_the_image_of_a_usdz_shows_the_photo(tmp_path: Path):
    chairs = load_model("chairs")
    instance = striped(chairs, chairs.camera(1.1, 0.3).resized(192, 192))
    images = []
    for name, variant in (("photo.usdz", instance), ("codes.usdz", instance.with_detail(None))):
        list(export_mesh(variant, tmp_path / name, MeshSettings(48, texture=128)))
        with zipfile.ZipFile(tmp_path / name) as file:
            images.append(np.asarray(Image.open(io.BytesIO(file.read("colours.jpg")))).astype(int))
    assert (np.abs(images[0] - images[1]).max(-1) > 30).mean() > 0.02
