import torch

from viewer.values.variety import families, readable


def test_variants_are_behind_the_first_of_their_form_under_readable_names() -> None:
    names = ["kenney_chair", "kenney_chair-form1-look2", "chairs-0000001-0000001", "chairs-0000001-0000201", "mine"]
    instance = torch.tensor([[0.0], [0.2], [1.0], [1.0], [5.0]])
    assert families(names, instance) == {
        "kenney_chair": ("kenney_chair-form1-look2",),
        "mine": (),
        "chairs-0000001-0000001": ("chairs-0000001-0000201",),
    }
    assert readable("scopia_armchair2") == "Armchair 2"
    assert readable("gazebo_hatchback_blue") == "Hatchback blue"
    assert readable("photo of Tuesday (2)") == "photo of Tuesday"
