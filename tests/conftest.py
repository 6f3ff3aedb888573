"""Shapes and types of core are checked at run time, and what core and viewer tests share is made here."""

import copy
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import hypothesis
import jaxtyping
import pytest
from jaxtyping import install_import_hook

import tests.checked  # noqa: F401  (the hook finds it by name)

# Before torch is imported, here and in the processes that tests start: threads that share a processor with another busy
# process wait for the slower one at every operation, and networks as small as those of the tests do not need them.
os.environ["OMP_NUM_THREADS"] = "1"
os.environ["LP_NUM_THREADS"] = "1"  # of Mesa's OpenGL
os.environ["CODENERF_THREADS"] = "1"  # a process for each core runs tests

# Before anything of core is.
install_import_hook("core", "tests.checked.checked")

hypothesis.settings.register_profile(
    "shared machine",
    deadline=None,  # no clock: another process may hold the processor at any moment
    suppress_health_check=(hypothesis.HealthCheck.too_slow,),
    derandomize=True,
    max_examples=50,
)
hypothesis.settings.load_profile("shared machine")

import moderngl  # noqa: E402
import torch  # noqa: E402
from PIL import Image  # noqa: E402

from core.gl.offscreen import OffscreenRenderer  # noqa: E402
from core.models.codes import CodeBook, Entry  # noqa: E402
from core.models.field import Field  # noqa: E402
from core.models.field_config import FieldConfig  # noqa: E402
from core.models.model import Model  # noqa: E402
from core.models.open_models import OpenModels  # noqa: E402
from core.runtime.precision import use_dtype  # noqa: E402

torch.set_num_threads(1)  # where it was imported before


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--matmul",
        choices=("float32", "bfloat16"),
        default="float32",
        help="the format of linear layers; the program measures which is faster here",
    )


def pytest_xdist_auto_num_workers(config: pytest.Config) -> int | None:
    """No workers for a single file, which stays in this process: it would not be shared out."""
    alone = len(config.args) == 1 and Path(config.args[0].split("::")[0]).is_file()
    return 0 if alone else None


@pytest.fixture(scope="session", autouse=True)
def _matmul_format(request: pytest.FixtureRequest) -> Iterator[None]:
    """One for the whole run: what a busy machine measures differs from run to run."""
    with use_dtype(getattr(torch, request.config.getoption("--matmul"))):
        yield


@contextmanager
def unchecked_shapes() -> Iterator[None]:
    """No checks at run time: they take two thirds of a fit's time and of a window's."""
    jaxtyping.config.update("jaxtyping_disable", True)
    try:
        yield
    finally:
        jaxtyping.config.update("jaxtyping_disable", False)


@pytest.fixture(scope="session")
def shared() -> Path:
    """Material that is not part of the project: CODENERF_SHARED, or a folder beside the checkout."""
    folder = Path(os.environ.get("CODENERF_SHARED", Path(__file__).resolve().parents[2] / "shared"))
    if not folder.is_dir():
        pytest.skip(f"no shared data at {folder} (set CODENERF_SHARED)")
    return folder


def no_opengl(error: Exception) -> NoReturn:
    """Ends a test that cannot render: skipped, or failed where CI says that rendering should be possible."""
    message = f"no OpenGL to render with: {error}"
    if os.environ.get("CI", "").lower() == "true":
        pytest.fail(message)
    pytest.skip(message)


def offscreen(size: tuple[int, int], **options: Any) -> OffscreenRenderer:
    """OpenGL that draws baked objects without a window."""
    try:
        return OffscreenRenderer(size, **options)
    except RuntimeError as error:
        no_opengl(error)


@pytest.fixture(scope="module")
def gl() -> Iterator[moderngl.Context]:
    """OpenGL without a window."""
    try:
        context = moderngl.create_standalone_context(backend="egl")
    except Exception as error:
        no_opengl(error)
    yield context
    context.release()


def image_size(path: Path) -> tuple[int, int]:
    """Width and height in px of an image file, which is closed again."""
    with Image.open(path) as image:
        return image.size


def random_model(seed: int = 0, white_from_network: bool = False) -> Model:
    """An untrained model of six objects in six textures: a mist, but a different one for every code."""
    torch.manual_seed(seed)
    config = FieldConfig(width=16, shape_latent=8, texture_latent=4, position_frequencies=4, direction_frequencies=2)
    book = CodeBook(torch.randn(6, 8), torch.randn(6, 4), tuple(Entry(f"object {i}", i, i) for i in range(6)))
    options = {"metres": 0.9, "white_from_network": white_from_network}
    return Model(Field(config), book, (0.35, 0.3, 0.45), "chairs", 32, 32.8, 2.0, **options)


def open_models(*models: Model) -> OpenModels:
    """A registry of some models."""
    registry = OpenModels(random_model)
    for model in models:
        registry.add(model.fingerprint, model)
    return registry


def with_contrast(model: Model, contrast: float = 20.0) -> Model:
    """The model, its density sharpened."""
    field = copy.copy(model.field)
    field.config = replace(field.config, contrast=contrast)
    return replace(model, field=field)


@pytest.fixture
def model() -> Model:
    return random_model()
