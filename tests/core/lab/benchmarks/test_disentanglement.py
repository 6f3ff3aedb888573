from core.lab.benchmarks.disentanglement import measure
from core.lab.benchmarks.held_out_views import HeldOutView


def test_an_exchanged_texture_leaves_the_opacity_and_is_found_again(view: HeldOutView):
    (trial,) = measure(view, "exchange")
    assert trial.opacity == 0 and trial.partner == "stool1"
    assert min(trial.exchanged, trial.shape, trial.texture) > 15
    assert measure(HeldOutView(view.model, view.views), "exchange") == ()
