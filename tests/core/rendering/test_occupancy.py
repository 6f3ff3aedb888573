import torch

from core.rendering.occupancy import without_specks


def test_specks_and_haze_far_from_the_object_go_and_parts_of_it_stay():
    depth = torch.zeros(24, 24, 24)
    depth[2:12, 2:12, 2:12] = 2.0  # the object
    depth[12:17, 6, 6] = 0.1  # a thin part that is joined to it
    kept = depth > 0
    depth[6, 6, 12:22] = 0.01  # haze: two cells of it are near the object
    kept[6, 6, 12:14] = True
    depth[20:22, 20:22, 20:22] = 3.0  # a dense speck
    depth[18:22, 2:12, 2:12] = 1.0  # another part as large as a part is
    kept[18:22, 2:12, 2:12] = True
    assert torch.equal(without_specks(depth > 0, depth), kept)


def test_what_is_dense_nowhere_stays():
    haze = torch.full((8, 8, 8), 0.01)
    assert bool(without_specks(haze > 0, haze).all())
