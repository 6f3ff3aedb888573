from dataclasses import replace

import pytest
import torch

from core.models.model import Model
from tests.viewer.driver import finish
from viewer.editor import Editor
from viewer.session import Session


@pytest.mark.parametrize(
    "error",
    [
        MemoryError(),
        torch.OutOfMemoryError("CUDA out of memory.\nTried to allocate 2 GiB"),
        RuntimeError("[enforce fail] DefaultCPUAllocator: can't allocate memory: you tried to allocate 9 bytes"),
    ],
)
def test_a_render_that_fails_is_reported(session: Session, editor: Editor, error: Exception) -> None:
    def broken(model: Model, job: object):
        raise error
        yield

    session.jobs.backend = replace(session.jobs.backend, frames=broken)
    editor.sample("shape")
    finish(session)
    assert session.messages.errors == ["Cannot render the object: not enough memory; try a smaller size"]
