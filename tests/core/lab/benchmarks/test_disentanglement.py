from core.lab.benchmarks.disentanglement import measure
from core.lab.benchmarks.held_out_views import HeldOutView
from core.models.model import Model
from tests.core.lab.evaluation.test_protocol import views_of


def test_an_exchanged_texture_leaves_the_opacity_and_is_found_again(tiny: Model):
    view = HeldOutView(tiny, views_of(tiny, 0, 10), partner=views_of(tiny, 1, 10))
    (trial,) = measure(view, "exchange")
    assert trial.opacity == 0 and trial.partner == "stool1"
    assert min(trial.exchanged, trial.shape, trial.texture) > 15
    assert measure(HeldOutView(tiny, view.views), "exchange") == ()
