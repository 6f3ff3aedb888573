from dataclasses import replace

import torch

from core.models.code_map import CodeMap
from core.models.codes import CodeBook, Codes, Entry
from core.models.model import Model

SHAPE, TEXTURE = 5, 3


def book(objects: int, seed: int = 0) -> CodeBook:
    generator = torch.Generator().manual_seed(seed)
    shapes, textures = (torch.randn(objects, latent, generator=generator) for latent in (SHAPE, TEXTURE))
    return CodeBook(shapes, textures, tuple(Entry(f"object {i}", i, i) for i in range(objects)))


def test_codes_that_were_mapped_affinely_are_mapped_alike() -> None:
    former = book(200)
    turn, shift = torch.linalg.qr(torch.randn(SHAPE, SHAPE)).Q, torch.randn(SHAPE)
    now = replace(former, shapes=former.shapes @ turn + shift, textures=2 * former.textures)
    unseen = Codes(torch.randn(4, SHAPE), torch.randn(4, TEXTURE))
    mapped = CodeMap.fitted(former, now)(unseen)
    torch.testing.assert_close(mapped.shape, unseen.shape @ turn + shift, atol=2e-3, rtol=0)
    torch.testing.assert_close(mapped.texture, 2 * unseen.texture, atol=2e-3, rtol=0)


def test_only_objects_of_both_tell_of_the_change() -> None:
    former, more = book(200), book(300, seed=1)
    shapes, textures = (
        torch.cat([former.shapes + 1, more.shapes[200:]]),
        torch.cat([former.textures, more.textures[200:]]),
    )
    mapped = CodeMap.fitted(former, replace(more, shapes=shapes, textures=textures))(more[250])
    torch.testing.assert_close(mapped.shape, more[250].shape + 1, atol=2e-3, rtol=0)
    torch.testing.assert_close(mapped.texture, more[250].texture, atol=2e-3, rtol=0)


def test_a_model_file_keeps_the_map(model: Model, tmp_path) -> None:
    other = replace(model.codes, shapes=model.codes.shapes + 0.5)
    extended = replace(model, extends=("former",), code_map=CodeMap.fitted(model.codes, other))
    extended.save(tmp_path / "m.safetensors")
    again, codes = Model.load(tmp_path / "m.safetensors"), model.codes[2]
    assert again.fingerprint == model.fingerprint
    assert again.codes_of(codes, model.fingerprint) is codes
    assert again.codes_of(codes, "former") == extended.code_map(codes)
    assert (again.codes_of(codes, "former").shape - codes.shape).mean() > 0.1
