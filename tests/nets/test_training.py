"""Training: what can be learnt is, groups stay whole, budget and bits hold; Adam is torch's."""

import json
import subprocess
import sys
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch
from torch import nn

from pipeline.nets.descent import Adam, training_loop
from pipeline.nets.ffnn import network
from pipeline.nets.settings import (
    BackPropagationSettings,
    ClassicFuzzySettings,
    FuzzyFilteredSettings,
    NetworkSettings,
    TrainingSettings,
)
from pipeline.nets.training import METHODS, Trained, descend, restore, train, validation_groups
from tests.nets.samples import WAYS, Samples, tensors, warm_up

SHORT = TrainingSettings(passes=24, population=6, patience=24)
DATA = warm_up(200)


def trained(
    kind: NetworkSettings, method: str, data: Samples = DATA, settings: TrainingSettings = SHORT
) -> Trained:
    return train(kind, method, *data, settings=settings)


once = cache(trained)
"""The training of a kind by a method on the usual samples, for all tests that only read it."""


def rmse(found: Trained, data: Samples) -> float:
    return float(np.sqrt(np.mean((found.predict(data.x, data.c) - data.y) ** 2)))


@pytest.mark.parametrize(("kind", "method"), WAYS, ids=repr)
def test_each_overfits_twenty_samples(kind: NetworkSettings, method: str) -> None:
    """It has about as many weights as there are samples, or more."""
    data = warm_up(20)
    filtered = isinstance(kind, FuzzyFilteredSettings | ClassicFuzzySettings)
    rate = 0.01 if filtered else 0.1
    passes = 4000 if method == "back_propagation" else 200
    budget = TrainingSettings(
        passes=passes, patience=passes, validation=0.0, batch=5, learning_rate=rate, ridge=1e-9
    )
    wide = replace(kind, bands=6) if filtered else kind
    assert rmse(trained(wide, method, data, budget), data) < 0.02 * data.y.std()


@pytest.mark.parametrize("kind", [FuzzyFilteredSettings(bands=2), ClassicFuzzySettings(bands=2)])
@pytest.mark.parametrize("method", ["genetic", "projection"])
def test_what_a_network_can_represent_is_recovered(kind: NetworkSettings, method: str) -> None:
    """Samples of a network of the same kind; profiles that were not learnt from decide."""
    data = warm_up(400)
    first = trained(kind, "projection", data, replace(SHORT, passes=6))
    bands = first.network.bands.detach().clone()  # type: ignore[union-attr]
    bands[:, 0] = torch.tensor([1.1, 6.3])
    bands[:, 1] = torch.tensor([0.8, 1.9])
    first.network.set_bands(bands)  # type: ignore[operator, union-attr]
    with torch.no_grad():
        first.network.consequents.normal_(generator=torch.Generator().manual_seed(1))  # type: ignore[union-attr, operator]
    truth = data._replace(y=first.predict(data.x, data.c))
    learnt = Samples(*(part[data.group < 4] for part in truth))
    unseen = Samples(*(part[data.group == 4] for part in truth))
    passes = 1500 if method == "genetic" else 500
    budget = TrainingSettings(
        passes=passes, patience=passes, population=30, learning_rate=0.02, ridge=1e-10
    )
    found = trained(kind, method, learnt, budget)
    assert rmse(found, unseen) < 0.01 * truth.y.std()


@pytest.mark.parametrize(("kind", "method"), WAYS, ids=repr)
def test_two_trainings_and_a_restored_one_are_the_same_bits(
    kind: NetworkSettings, method: str
) -> None:
    one = once(kind, method)
    text = json.dumps(one.document(), allow_nan=False)
    assert text == json.dumps(trained(kind, method).document())
    other = trained(kind, method, settings=replace(SHORT, seed=1))
    assert other.history.tobytes() != one.history.tobytes()
    again = restore(json.loads(text))
    assert again.predict(DATA.x, DATA.c).tobytes() == one.predict(DATA.x, DATA.c).tobytes()
    assert (again.kind, again.method, again.settings) == (kind, method, SHORT)
    assert again.document() == one.document()


@pytest.mark.parametrize(("kind", "method"), WAYS, ids=repr)
def test_the_budget_holds_and_the_best_state_is_kept(kind: NetworkSettings, method: str) -> None:
    found = once(kind, method)
    assert (np.diff(found.history[:, 0]) > 0).all()
    # a generation is not begun that would go beyond
    assert SHORT.passes - SHORT.population < found.passes <= SHORT.passes
    kept = np.isin(DATA.group.astype(str), found.validation_groups)
    validation, training = (Samples(*(part[rows] for part in DATA)) for rows in (kept, ~kept))
    best = found.history[found.history[:, 2].argmin()]
    assert rmse(found, validation) == pytest.approx(best[2], rel=1e-9)
    assert rmse(found, training) == pytest.approx(best[1], rel=1e-9)


def test_patience_ends_a_training() -> None:
    settings = replace(SHORT, passes=3000, patience=5, learning_rate=0.5)
    found = trained(FuzzyFilteredSettings(), "gradient", settings=settings)
    best = int(found.history[found.history[:, 2].argmin(), 0])
    assert found.passes == best + 5 < 3000


def test_validation_groups_are_whole_and_never_learnt_from() -> None:
    """Another output in the groups for validation changes no weight after as many passes."""
    kept = validation_groups(
        DATA.group.astype(str).tolist(), SHORT.validation, SHORT.seed, "training"
    )
    assert len(kept) == 1
    held = np.isin(DATA.group.astype(str), kept)
    assert 0 < held.sum() < len(held)
    spoilt = DATA._replace(
        y=np.where(held, -DATA.y, DATA.y), x=np.where(held[:, None], 99.0, DATA.x)
    )
    for kind, method in WAYS:
        one, two = once(kind, method), trained(kind, method, spoilt)
        assert one.validation_groups == two.validation_groups == kept
        np.testing.assert_array_equal(one.history[:, 1], two.history[: len(one.history), 1])
        for part in ("x_scaling", "c_scaling", "y_scaling"):
            mine, theirs = getattr(one, part), getattr(two, part)
            np.testing.assert_array_equal(mine.shift, theirs.shift)
            np.testing.assert_array_equal(mine.scale, theirs.scale)


@pytest.mark.parametrize(("share", "many"), [(0.0, 0), (0.01, 1), (0.4, 4), (0.99, 9)])
def test_as_many_groups_are_kept_as_asked_and_one_is_always_left(share: float, many: int) -> None:
    labels = [f"profile {k % 10}" for k in range(95)]
    kept = validation_groups(labels, share, SHORT.seed, "training")
    assert len(set(kept)) == len(kept) == many and set(kept) <= set(labels)


def test_where_samples_stand_does_not_matter_to_least_squares() -> None:
    """The same samples in another order, groups torn apart: the same network but for rounding."""
    order = np.random.default_rng(5).permutation(len(DATA.y))
    mixed = Samples(*(part[order] for part in DATA))
    one, two = (trained(FuzzyFilteredSettings(), "projection", part) for part in (DATA, mixed))
    assert one.validation_groups == two.validation_groups
    np.testing.assert_allclose(one.predict(DATA.x, DATA.c), two.predict(DATA.x, DATA.c), rtol=1e-6)


@pytest.mark.parametrize(("kind", "method"), WAYS, ids=repr)
def test_units_do_not_matter(kind: NetworkSettings, method: str) -> None:
    """Kelvin or millikelvin above another reference, micrometres or metres."""
    other = Samples(1e3 * DATA.x + 7e3, 1e-3 * DATA.c - 2.0, 1e-6 * DATA.y + 1.0, DATA.group)
    short = replace(SHORT, passes=6)
    one, two = trained(kind, method, DATA, short), trained(kind, method, other, short)
    a, b = one.predict(DATA.x, DATA.c), two.predict(other.x, other.c)
    np.testing.assert_allclose(1e6 * (b - 1.0), a, atol=1e-3 * a.std())


def test_a_step_of_back_propagation_is_the_gradient_of_half_the_squared_error() -> None:
    made = network(BackPropagationSettings(), 9, 3, torch.Generator().manual_seed(0))
    rng = np.random.default_rng(0)
    x, y = rng.normal(size=(1, 9)), rng.normal(size=1)
    (0.5 * (made(*tensors(x, x[:, :3])) - torch.from_numpy(y)) ** 2).sum().backward()
    before = [p.detach().clone() for p in made.parameters()]
    weights = [p.detach().numpy() for p in made.parameters()]
    descend(np.array([0]), x, y, *weights, np.empty(7), 0.01)
    for p, old in zip(made.parameters(), before, strict=True):
        torch.testing.assert_close(p.detach(), old - 0.01 * p.grad, rtol=1e-12, atol=1e-15)


def test_constant_inputs_and_output_are_learnt_as_they_are() -> None:
    data = Samples(
        np.full((20, 4), 3.0), np.full((20, 2), 0.1), np.full(20, 5.0), np.arange(20) % 2
    )
    for kind, method in WAYS:
        found = trained(kind, method, data).predict(data.x, data.c)
        np.testing.assert_allclose(found, 5.0, atol=0.5)


def test_torch_is_left_as_it_was() -> None:
    before = torch.get_num_threads(), torch.are_deterministic_algorithms_enabled()
    state = torch.random.get_rng_state()
    trained(BackPropagationSettings(), "gradient").predict(DATA.x, DATA.c)
    assert (torch.get_num_threads(), torch.are_deterministic_algorithms_enabled()) == before
    assert torch.equal(torch.random.get_rng_state(), state)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"x": np.where(np.arange(9) == 4, np.nan, DATA.x)}, r"200 values .* first at \(0, 4\)"),
        ({"y": np.full(200, np.inf)}, "y has 200 values that are not finite"),
        ({"x": DATA.x[:, 0]}, r"x has shape \(200,\): give it 2"),
        ({"c": DATA.c[:-1]}, "have 200, 199, 200 and 200 samples"),
        ({"group": DATA.group[:3]}, "have 200, 200, 200 and 3 samples"),
        ({"group": np.zeros(200, int)}, "there is one recording, '0',"),
        ({"x": DATA.x[:, :2]}, "on 2 sensors and 3 consequent inputs"),
        ({name: getattr(DATA, name)[:0] for name in DATA._fields}, "no samples"),
    ],
)
def test_samples_that_nothing_can_be_learnt_from_are_refused(change: dict, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        trained(FuzzyFilteredSettings(), "projection", DATA._replace(**change))


def test_a_method_of_another_kind_is_refused() -> None:
    with pytest.raises(ValueError, match="'genetic' does not train a back_propagation network"):
        trained(BackPropagationSettings(), "genetic")
    assert set(METHODS) == {kind.kind for kind, _ in WAYS}


def test_a_rate_that_diverges_at_once_is_refused_by_its_name() -> None:
    with pytest.raises(ValueError, match=r"lower training\.learning_rate"):
        trained(
            BackPropagationSettings(),
            "back_propagation",
            settings=replace(SHORT, learning_rate=1e9),
        )


def test_predictions_of_what_does_not_fit_are_refused() -> None:
    found = once(FuzzyFilteredSettings(), "projection")
    with pytest.raises(ValueError, match="takes 9 temperatures and 3 consequent inputs"):
        found.predict(DATA.x[:, :8], DATA.c)
    with pytest.raises(ValueError, match="c has 1 values that are not finite"):
        found.predict(DATA.x[:1], [[0.0, np.nan, 0.0]])
    assert found.predict(DATA.x[:0], DATA.c[:0]).shape == (0,)


@pytest.mark.parametrize("lost", ["kind", "network", "scaling", "state", "history", "training"])
def test_a_document_that_lacks_something_is_refused(lost: str) -> None:
    document = once(FuzzyFilteredSettings(), "projection").document()
    del document[lost]
    with pytest.raises(ValueError, match=f"no or no known '{lost}'"):
        restore(document)


def test_a_document_whose_numbers_do_not_fit_is_refused() -> None:
    document = once(FuzzyFilteredSettings(), "projection").document()
    with pytest.raises(ValueError, match="does not fit together"):
        restore(document | {"network": {"bands": 5}})
    with pytest.raises(ValueError, match="does not fit together"):
        restore(document | {"network": {"unknown": 5}})


@pytest.mark.parametrize(
    ("name", "value"),
    [("passes", 0), ("ridge", 0.0), ("validation", 1.0), ("learning_rate", 0.0), ("breadth", 0.0)],
)
def test_settings_out_of_range_are_refused(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"training.{name} = {value}"):
        TrainingSettings(**{name: value})  # type: ignore[arg-type]


def test_a_budget_below_one_population_is_refused() -> None:
    with pytest.raises(
        ValueError, match=r"training\.passes = 5 must be at least training\.population"
    ):
        TrainingSettings(passes=5)


def test_settings_are_read_without_torch() -> None:
    """A stage that trains no network must not wait for it."""
    asked = "import sys, pipeline.nets.settings; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", asked], check=False).returncode == 0


@pytest.mark.parametrize(("ends_at", "seen"), [(0, [3, 6, 7]), (6, [3, 6])])
def test_the_loop_may_stop_every_so_many_passes_and_after_the_last(
    ends_at: int, seen: list[int]
) -> None:
    called: list[int] = []

    def stopped(done: int) -> bool:
        called.append(done)
        return done == ends_at

    assert list(training_loop(7, stopped, every=3)) == list(range(1, seen[-1] + 1))
    assert called == seen


def perceptron() -> nn.Module:
    torch.manual_seed(0)
    return nn.Sequential(nn.Linear(3, 8), nn.Tanh(), nn.Linear(8, 1)).double()


@pytest.mark.parametrize(("l2", "decay"), [(0.0, 0.0), (0.02, 0.0), (0.0, 0.05)])
def test_its_steps_are_those_of_torch(l2: float, decay: float) -> None:
    mine, theirs = perceptron(), perceptron()
    x, y = torch.randn(20, 3, dtype=torch.float64), torch.randn(20, 1, dtype=torch.float64)
    weights = list(mine.parameters())
    adam = Adam(weights, 0.03, betas=(0.8, 0.99), l2=[l2] * len(weights), decay=decay)
    kind = torch.optim.AdamW if decay else torch.optim.Adam
    oracle = kind(theirs.parameters(), lr=0.03, betas=(0.8, 0.99), weight_decay=decay or 2.0 * l2)
    for k in range(30):
        adam.rate = oracle.param_groups[0]["lr"] = 0.03 / (1 + k)
        adam.step((mine(x) - y).square().mean())
        oracle.zero_grad()
        (theirs(x) - y).square().mean().backward()
        oracle.step()
    for one, other in zip(mine.parameters(), theirs.parameters(), strict=True):
        torch.testing.assert_close(one, other, rtol=1e-9, atol=1e-12)  # of sums in another order


def test_a_weight_that_the_loss_does_not_see_stays() -> None:
    seen, unseen = nn.Parameter(torch.ones(2)), nn.Parameter(torch.ones(3))
    Adam([seen, unseen], 0.1).step(seen.sum())
    assert (seen < 1).all() and (unseen == 1).all()


@pytest.mark.proof
def test_a_training_imports_no_compiler() -> None:
    """It takes a second, in each process of a stage."""
    said = (
        "import sys, torch\n"
        "from pipeline.nets.descent import Adam\n"
        "from pipeline.nets.stored import reproducible\n"
        "weight = torch.nn.Parameter(torch.ones(2))\n"
        "with reproducible():\n"
        "    Adam([weight], 0.1).step(weight.sum())\n"
        "print('torch._dynamo' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", said], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"
