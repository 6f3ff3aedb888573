import torch

from viewer.values.variety import families, farthest_first, readable


def test_the_most_different_come_first_and_each_once() -> None:
    points = torch.tensor([[0.0], [0.1], [10.0], [4.0], [4.0]])
    assert farthest_first(points) == [0, 2, 3, 1, 4]
    assert farthest_first(torch.empty(0, 3)) == []


def test_variants_are_behind_the_first_of_their_form() -> None:
    names = ["kenney_chair", "kenney_chair-form1-look2", "chairs-0000001-0000001", "chairs-0000001-0000201", "mine"]
    codes = torch.tensor([[0.0], [0.2], [1.0], [1.0], [5.0]])
    assert families(names, codes) == {
        "kenney_chair": ("kenney_chair-form1-look2",),
        "mine": (),
        "chairs-0000001-0000001": ("chairs-0000001-0000201",),
    }


def test_names_are_readable() -> None:
    assert readable("scopia_armchair2") == "Armchair 2"
    assert readable("gazebo_hatchback_blue") == "Hatchback blue"
    assert readable("photo of Tuesday (2)") == "photo of Tuesday (2)"
