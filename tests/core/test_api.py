"""The library's face, and the lines of Python on the front page."""

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import core
from core import api
from core.fitting.fit import FitJob, FitStep
from core.fitting.settings import PRESETS, FitSettings
from core.models.model import Model
from core.photos.clip import FRAMES
from tests.core.photos.test_clip_object import write_blocks
from tests.core.tiny import photo_of

ROOT = Path(__file__).resolve().parents[2]
_LINES = 6  # of Python on the front page, at most


def front_page_lines() -> str:
    """The Python of README.md."""
    (lines,) = re.findall(r"^```python\n(.*?)^```", (ROOT / "README.md").read_text(), re.DOTALL | re.MULTILINE)
    return str(lines)


def test_the_lines_of_the_front_page_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "assets").symlink_to(ROOT / "assets")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(api, "SETTINGS", PRESETS["draft"])
    monkeypatch.setattr(api, "SIZE", 48)
    lines = front_page_lines()
    assert len([line for line in lines.splitlines() if line]) <= _LINES
    names: dict[str, object] = {}
    exec(lines, names)
    assert (tmp_path / "chair.mp4").stat().st_size > 1000
    printed = capsys.readouterr().out.splitlines()
    assert printed[0].startswith("Cutting out") and printed[-1].startswith("Found at azimuth")
    chair = names["chair"]
    assert isinstance(chair, core.Instance) and chair.detail is not None


def test_importing_the_package_is_cheap_and_offers_its_names() -> None:
    script = "import core, sys; assert not {'torch', 'numpy', 'core.api'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", script], check=True, cwd=ROOT)
    assert core.__all__ == api.__all__
    assert all(getattr(core, name) is getattr(api, name) for name in core.__all__)
    with pytest.raises(AttributeError, match="nothing"):
        _ = core.nothing


def test_a_prepared_photo_is_fitted_equally_by_the_same_seed_and_rendered_from_its_camera(tiny: Model) -> None:
    photo = photo_of(tiny[1], tiny.camera(1.2, 0.3))
    hasty = FitSettings(hypotheses=4, steps=4, rays=64, samples=16, free_steps=1, max_restarts=0)
    first, second = (core.fit(tiny, photo, settings=hasty, seed=4) for _ in range(2))
    assert first == second and first.model is tiny
    camera = core.camera_of(first, (40, 30))
    assert first.detail is not None and camera == first.detail.views[0].camera.resized(40, 30)
    image = core.render(first, camera)
    assert image.shape == (30, 40, 3) and (image < 255).any()


def test_a_video_is_fitted_as_photos_of_one_object(
    tiny: Model, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_blocks(tmp_path / "walk.mp4", [10, 20, 30])
    counts: list[int] = []

    def fit(model: Model, job: FitJob) -> Iterator[FitStep]:
        counts.append(len(job.photos))
        yield FitStep(1, 1, 0, 0.4, 30.0, 0.1, (model.camera(1.2, 0.3),) * len(job.photos), model[1])

    monkeypatch.setattr(api.fitting, "fit", fit)
    assert core.fit(tiny, path) == tiny[1]
    assert counts == [FRAMES]


def test_bad_input_is_refused_by_name(tiny: Model, tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(b"no image")
    for act in (
        lambda: core.fit(tiny, tmp_path / "a.png"),
        lambda: core.write_video(tiny[0], tmp_path / "a.png", frames=1),
        lambda: core.export_mesh(tiny[0], str(tmp_path / "a.png")),
        lambda: core.write_page(tiny[0], tmp_path / "a.png"),
    ):
        with pytest.raises(ValueError, match="a\\.png"):
            act()
