"""What an experiment sets stands on top of conf/ as it is now, or is refused in one sentence."""

import json
import shutil
import subprocess
from pathlib import Path

import pytest
import yaml

from pipeline.parameters import CATALOGUES, read_params
from pipeline.stages.compose import BASELINE, compose, composed
from tests.small_project import store, with_conf

FIT, LIMITS = "conf/model/spindle.yaml", "spindle_limits"


def git(folder: Path, *words: str) -> str:
    name = ("-c", "user.name=a", "-c", "user.email=a@b.c")
    done = subprocess.run(["git", *name, *words], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.fixture(scope="module")
def committed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project whose commit has the composition of its conf/."""
    root = with_conf(tmp_path_factory.mktemp("project"))
    compose(root / "conf", root / "params.yaml", root / "data/settings")
    git(root, "init", "-q")
    git(root, "add", ".")
    git(root, "commit", "-q", "-m", "composed")
    return root


@pytest.fixture
def root(committed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of it, inside of an experiment that starts from its commit."""
    monkeypatch.setenv(BASELINE, "HEAD")
    return shutil.copytree(committed, tmp_path / "clone", symlinks=True)


def set_(root: Path, path: str, value: object) -> None:
    """As ``dvc exp run -S path=value`` writes it."""
    values = params(root)
    place, (*keys, last) = values, path.split(".")
    for key in keys:
        place = place[key]
    place[last] = value
    store(root, values)


def edit(root: Path, before: str, after: str) -> None:
    text = (root / FIT).read_text()
    assert text.count(before) == 1
    (root / FIT).write_text(text.replace(before, after))


def params(root: Path) -> dict:
    return read_params(root / "params.yaml")


def again(root: Path) -> dict:
    compose(root / "conf", root / "params.yaml", root / "data/settings")
    return params(root)


def test_an_edit_of_conf_and_what_is_set_both_hold(root: Path) -> None:
    before = params(root)
    trees = before["residual_forest"]["trees"]
    edit(root, f"trees: {trees}", "trees: 7")
    set_(root, f"{LIMITS}.mae_K", 1.25)
    found = again(root)
    assert found["residual_forest"].pop("trees") == 7 != before["residual_forest"].pop("trees")
    assert found[LIMITS].pop("mae_K") == 1.25 != before[LIMITS].pop("mae_K")
    assert found == before


def test_nothing_set_is_the_composition_byte_for_byte(root: Path) -> None:
    compose(root / "conf", root / "params.yaml", root / "data/settings")
    assert params(root) == yaml.safe_load(composed(root / "conf"))


def test_outside_of_an_experiment_conf_alone_counts(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = params(root)
    set_(root, f"{LIMITS}.mae_K", 1.25)
    monkeypatch.delenv(BASELINE)
    assert again(root) == before


def test_a_budget_that_is_set_is_the_group(root: Path) -> None:
    set_(root, "budget", "quick")
    set_(root, "residual_forest.leaf", 3)
    quick = yaml.safe_load(composed(root / "conf", ("budget=quick",)))
    assert quick["residual_forest"]["trees"] != params(root)["residual_forest"]["trees"]
    quick["residual_forest"]["leaf"] = 3
    assert again(root) == quick


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        ("budget", "quickly", "-S budget=quickly names no file of conf/budget: choose one of "
                              "default, full, quick"),
        ("fleet", "recorded", "run `kerf fleet NAME` first"),
        ("fleet.machines", ["mill01"], r"-S fleet\.machines cannot be set"),
        ("model", "steel", "-S model is no choice"),
        (f"{LIMITS}.mae_C", 1, r"mae_C.*@ spindle_limits"),
        (f"{LIMITS}.mae_K", "soon", r"'soon' is no number @ spindle_limits\.mae_K"),
        ("spindle_limit", {"mae_K": 1}, "section spindle_limit, did you mean spindle_limits"),
        ("machine.mill02.drives", {}, r"section machine\.mill02\.drives, did you mean drive"),
    ],
)  # fmt: skip
def test_what_cannot_be_set_is_refused_and_nothing_is_written(
    root: Path, path: str, value: object, said: str
) -> None:
    set_(root, path, value)
    before = (root / "params.yaml").read_text()
    with pytest.raises(ValueError, match=said) as caught:
        compose(root / "conf", root / "params.yaml", root / "data/settings")
    assert "\n" not in str(caught.value)
    assert (root / "params.yaml").read_text() == before


def test_a_section_of_the_settings_is_not_set_in_params_yaml(root: Path) -> None:
    path = root / "params.yaml"
    path.write_text(path.read_text() + "machine: {mill01: {wear_life: {criterion_um: 100}}}\n")
    with pytest.raises(ValueError, match=r"holds machine, which stands in data/settings/machine/m"):
        again(root)


def test_a_setting_of_a_machine_is_set_in_its_file(root: Path) -> None:
    set_(root, "machine.mill01.wear_life.criterion_um", 100.0)
    assert '"criterion_um": 100.0' in (root / "data/settings/machine/mill01.json").read_text()
    assert again(root)["machine"]["mill01"]["wear_life"]["criterion_um"] == 100.0


def test_a_changed_setting_changes_the_hash_of_its_section_alone(root: Path) -> None:
    """By which the stages that read the section know that it has changed."""
    file = root / "data/settings/sections/mill01.json"
    before = json.loads(file.read_text())
    values = params(root)
    shared = values.keys() - {"machine", *CATALOGUES}
    assert before.keys() == shared | values["machine"]["mill01"].keys()
    values = root / "data/settings/machine/mill01.json"
    own = json.loads(values.read_text())
    own["wear_life"]["criterion_um"] = 101.0
    values.write_text(json.dumps(own))
    again(root)
    after = json.loads(file.read_text())
    assert {name for name in before if before[name] != after[name]} == {"wear_life"}


def test_settings_that_are_no_mapping_are_named(root: Path) -> None:
    (root / "data/settings/machine/mill01.json").write_text("[1]")
    with pytest.raises(ValueError, match=r"machine/mill01.json holds list, a mapping is needed"):
        params(root)


def test_a_key_that_is_edited_and_set_is_asked_back(root: Path) -> None:
    now = params(root)["residual_forest"]["trees"]
    edit(root, f"trees: {now}", "trees: 7")
    set_(root, "residual_forest.trees", 8)
    with pytest.raises(ValueError, match=rf"trees is 8 in params\.yaml, 7 in conf/ and {now} in"):
        compose(root / "conf", root / "params.yaml", root / "data/settings")


def test_a_section_of_a_machine_that_no_list_names_is_checked_as_well(root: Path) -> None:
    fleet = root / "conf/fleet/active.yaml"
    text = fleet.read_text().replace("  wear: [mill01, mill02]", "  wear: [mill01]")
    assert text != fleet.read_text()
    fleet.write_text(text)
    machine = root / "conf/machine/mill02.yaml"
    known = machine.read_text()
    machine.write_text(known.replace("\nwear_life:", "\nwear_lives:"))
    with pytest.raises(
        ValueError, match=r"section machine\.mill02\.wear_lives, did you mean wear_life"
    ):
        compose(root / "conf", root / "params.yaml", root / "data/settings")
    old = known.replace("\nfollowing_residual_records:", "\ncompensation_records:")
    machine.write_text(old)
    with pytest.raises(ValueError, match="is called following_residual_records now: rename it"):
        compose(root / "conf", root / "params.yaml", root / "data/settings")
    machine.write_text(known.replace("\nenergy:", "\nwear_life:"))
    with pytest.raises(ValueError, match=r"conf does not compose: .*duplicate key wear_life"):
        compose(root / "conf", root / "params.yaml", root / "data/settings")


PUBLISHED = {
    "drive_fit.genetic.generations": 500,  # Sim2023
    "cutting_fit.genetic.generations": 500,
    "residual_forest.trees": 300,  # Twin2026
    "residual_forest.depth": 14,
    "residual_forest.leaf": 5,
    "tuning.method": "whale",  # Feed2025
    "tuning.population": 8,
    "tuning.generations": 20,
    "tuning.units": [50, 100],
    "tuning.l2": [1e-4, 1e-1],
    "following_residual_fit.units": 50,
    "following_residual_fit.filters": 16,
    "following_residual_fit.training.validation": 0.2,
    "deformation_fit.every_s": 60.0,  # FFNN2015
    "synthesis_fit.network.latent": 3500,  # DCGAN2019
    "synthesis_fit.network.discriminator": [128, 128, 64, 64],
    "synthesis_fit.network.dropout": 0.5,
    "synthesis_fit.training.learning_rate": 1e-4,
    "synthesis_fit.training.steps": 148_000,
}
"""Sizes of the papers, by setting."""


def test_the_full_budget_has_the_sizes_of_the_papers(tmp_path: Path) -> None:
    full = yaml.safe_load(composed(with_conf(tmp_path) / "conf", ("budget=full",)))
    for path, size in PUBLISHED.items():
        found = full
        for key in path.split("."):
            found = found[key]
        assert found == size, path
