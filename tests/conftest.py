"""What several rooms' tests need."""

import gc
import os
import pickle
import shutil
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from hashlib import sha256
from pathlib import Path
from types import CodeType
from typing import Any
from unittest import mock

import pytest
import yaml
from hypothesis import HealthCheck, settings
from hypothesis.internal.conjecture import providers
from jinja2 import Environment
from typer import Typer, testing

from pipeline.stages import compose
from tests.browser import CHROMIUM, DRIVER, FLAGS
from tests.shared import made_once

# The same examples in every run, so that a change and not chance decides; other ones are sought by
# `HYPOTHESIS_PROFILE=search pytest`.
# No example is refused for the time that it took: that is the machine's, not the code's.
CALM = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}
settings.register_profile("same", derandomize=True, **CALM)
settings.register_profile("search", derandomize=False, **CALM)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "same"))
# Hypothesis also tries numbers that stand in whatever modules happen to be loaded, which differ
# with the tests that ran before in the same process.
providers._get_local_constants = providers.Constants

# DVC starts two processes after each command, one that counts its users and one that seeks updates.
os.environ["DVC_TEST"] = "true"
gc.set_threshold(50_000)  # as the command has it: 5 % of the time was the collector's
SHORT_TEXT, LONG_TEXT = 100, 5000
"""Characters from which what a text says is kept, and from which it is parsed by libyaml."""


def pytest_collection_finish() -> None:
    """What is loaded by now stays, so that the collector need not walk it again and again."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def compositions(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """The same files of conf/ are composed once in a run: it takes Hydra a second."""

    def composed(conf: Path, overrides: tuple[str, ...] = ()) -> str:
        files = [f for f in sorted(conf.rglob("*")) if f.is_file()]
        key = overrides, [(str(f.relative_to(conf)), f.read_bytes()) for f in files]
        name = f"composition-{sha256(repr(key).encode()).hexdigest()}"
        made = made_once(
            tmp_path_factory, name, lambda f: (f / "text").write_text(original(conf, overrides))
        )
        return (made / "text").read_text()

    original = compose.composed
    places = [one for one in list(sys.modules.values())
              if getattr(one, "__dict__", {}).get("composed") is original]  # fmt: skip
    with ExitStack() as stack:
        for place in places:  # tests import it by its name
            stack.enter_context(mock.patch.object(place, "composed", composed))
        yield


@pytest.fixture(scope="session", autouse=True)
def parsed_texts() -> Iterator[None]:
    """The same text of YAML is parsed once in a session: each composition loads all of conf/."""
    known: dict[object, bytes] = {}

    def load(stream: Any, Loader: Any) -> Any:
        text = stream.read() if hasattr(stream, "read") else stream
        key = (
            text,
            Loader.__module__,
            Loader.__qualname__,
        )  # OmegaConf makes its class anew each time
        if key not in known:
            is_long = len(text) >= LONG_TEXT
            fast = yaml.CSafeLoader if is_long and Loader is yaml.SafeLoader else Loader
            if hasattr(stream, "seek"):  # an error names the file
                stream.seek(0)
            values = original(stream if hasattr(stream, "seek") else text, fast)
            if len(text) < SHORT_TEXT:
                return values
            known[key] = pickle.dumps(values)
        return pickle.loads(known[key])

    original = yaml.load
    with mock.patch.object(yaml, "load", load):
        yield


@pytest.fixture(scope="session", autouse=True)
def composed_nodes() -> Iterator[None]:
    """The same of the nodes of a long text, which nothing changes; a catalogue's take 0.3 s."""
    known: dict[str, yaml.Node | None] = {}

    def compose_text(stream: Any, Loader: Any) -> yaml.Node | None:
        if not isinstance(stream, str) or len(stream) < LONG_TEXT or Loader is not yaml.SafeLoader:
            return original(stream, Loader)
        if stream not in known:
            known[stream] = original(stream, yaml.CSafeLoader)  # of the same nodes
        return known[stream]

    original = yaml.compose
    with mock.patch.object(yaml, "compose", compose_text):
        yield


@pytest.fixture(scope="session", autouse=True)
def compiled_templates() -> Iterator[None]:
    """The same template is compiled once in a session; those of a report take 0.1 s."""
    known: dict[object, CodeType] = {}

    def compiled(self: Environment, source: Any, *where: Any, **how: Any) -> Any:
        rules = self.finalize, self.autoescape, self.trim_blocks, self.lstrip_blocks
        key = source, where, *how.items(), rules
        if key not in known:
            known[key] = original(self, source, *where, **how)
        return known[key]

    original = Environment.compile
    with mock.patch.object(Environment, "compile", compiled):
        yield


@pytest.fixture(scope="session", autouse=True)
def built_commands() -> Iterator[None]:
    """A command line is built of its functions once in a session; that of ``kerf`` takes 20 ms."""
    known: dict[object, Any] = {}

    def built(app: Typer) -> Any:
        key = app, len(app.registered_commands), len(app.registered_groups)
        if key not in known:
            known[key] = original(app)
        return known[key]

    original = testing._get_command
    with mock.patch.object(testing, "_get_command", built):
        yield


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    options.binary_location = str(CHROMIUM)
    for flag in (*FLAGS, f"--user-data-dir={tmp_path_factory.mktemp('profile')}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = webdriver.Chrome(options=options, service=Service(str(DRIVER)))
    yield driver
    driver.quit()


@pytest.fixture
def project(template: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the module's ``template`` of a project, to work in."""
    root = Path(shutil.copytree(template, tmp_path / "project", symlinks=True))
    monkeypatch.chdir(root)
    return root
