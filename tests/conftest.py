"""Shapes and types are checked at run time, and what core and viewer tests share is made here."""

import os
from pathlib import Path
from typing import NoReturn

import hypothesis
import pytest
from jaxtyping import install_import_hook

import tests.checked  # noqa: F401  (the hook finds it by name)

# Before torch is imported, here and in the processes that tests start: threads that share a processor with another busy
# process wait for the slower one at every operation, and networks as small as those of the tests do not need them.
os.environ.setdefault("OMP_NUM_THREADS", "1")

# Before anything of core or viewer is.
install_import_hook(("core", "viewer"), "tests.checked.checked")

hypothesis.settings.register_profile(
    "shared machine",
    deadline=None,  # no clock: another process may hold the processor at any moment
    suppress_health_check=(hypothesis.HealthCheck.too_slow,),
    derandomize=True,
    max_examples=50,
)
hypothesis.settings.load_profile("shared machine")

import torch  # noqa: E402
from PIL import Image  # noqa: E402

from core.models.codes import CodeBook, Entry  # noqa: E402
from core.models.field import Field  # noqa: E402
from core.models.field_config import FieldConfig  # noqa: E402
from core.models.model import Model  # noqa: E402


@pytest.fixture(scope="session")
def shared() -> Path:
    """Material that is not part of the project: CODENERF_SHARED, or a folder beside the checkout."""
    folder = Path(os.environ.get("CODENERF_SHARED", Path(__file__).resolve().parents[2] / "shared"))
    if not folder.is_dir():
        pytest.skip(f"no shared data at {folder} (set CODENERF_SHARED)")
    return folder


def no_opengl(error: Exception) -> NoReturn:
    """Ends a test that cannot render: skipped, or failed where CI says that rendering should be possible."""
    said = f"no OpenGL to render with: {error}"
    if os.environ.get("CI", "").lower() == "true":
        pytest.fail(said)
    pytest.skip(said)


def image_size(path: Path) -> tuple[int, int]:
    """Width and height in px of an image file, which is closed again."""
    with Image.open(path) as image:
        return image.size


def random_model(seed: int = 0, white_from_network: bool = False, film: bool = False) -> Model:
    """An untrained model of six objects in six textures: a mist, but a different one for every code."""
    torch.manual_seed(seed)
    sizes = {"width": 16, "shape_latent": 8, "texture_latent": 4, "position_frequencies": 4, "direction_frequencies": 2}
    book = CodeBook(torch.randn(6, 8), torch.randn(6, 4), tuple(Entry(f"object {i}", i, i) for i in range(6)))
    field = Field(FieldConfig(**sizes, film=film))
    for layer in field.shape_scale:
        torch.nn.init.normal_(layer.weight, std=0.2)
    return Model(field, book, (0.35, 0.3, 0.45), "chairs", 32, 32.8, 2.0, white_from_network)


@pytest.fixture
def model() -> Model:
    return random_model()
