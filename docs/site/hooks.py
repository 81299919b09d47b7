"""Hooks of the site: pages from README, notebooks, docstrings, settings and key figures."""

import ast
import re
import subprocess
import sys
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

sys.path.insert(0, str(Path(__file__).parent))
import notebook_pages
import validation

ROOT = Path(__file__).parents[2]
COPIES = {
    "README.md": "index.md",
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
}
"""Pages of the repository's root, and their names in the site."""
SETTINGS = "settings.md"
SOURCES = Path(__file__).resolve().parents[2]
"""Repository whose package describes the settings, also where docs/ is a link into it."""


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Fill in the notebooks and the reference, and leave out pages that are not there."""
    config.nav = [_filled(entry) for entry in config.nav]
    known = set(_pages(config.nav))
    more = [p.name for p in sorted((ROOT / "docs").glob("*.md")) if p.name not in known]
    if more:
        config.nav.append({"More": more})
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that are made."""
    for source, name in COPIES.items():
        text = (ROOT / source).read_text(encoding="utf-8")
        files.append(File.generated(config, name, content=_relinked(text)))
    for path in notebooks():
        page, pictures = notebook_pages.rendered(path)
        files.append(File.generated(config, f"notebooks/{path.stem}.md", content=page))
        for name, picture in pictures.items():
            files.append(File.generated(config, f"notebooks/{name}", content=picture))
    for name, content in described_settings().items():
        files.append(File.generated(config, name, content=content))
    for name, page in validations().items():
        files.append(File.generated(config, f"validation/{name}.md", content=page))
    for room in rooms():
        files.append(File.generated(config, f"reference/{room}.md", content=reference(room)))
    return files


@cache
def described_settings() -> dict[str, str]:
    """Settings page and JSON Schemas, as the code describes them, by path in the site."""
    command = [sys.executable, "-m", "pipeline.app", "machine", "schema"]
    with TemporaryDirectory() as place:
        folder = Path(place)
        subprocess.run(
            [*command, "--out", folder / "schema", "--page", folder / SETTINGS],
            cwd=SOURCES, check=True, stdout=subprocess.DEVNULL,
        )  # fmt: skip
        written = [folder / SETTINGS, *sorted((folder / "schema").iterdir())]
        return {str(path.relative_to(folder)): path.read_text("utf-8") for path in written}


@cache
def validations() -> dict[str, str]:
    """Tables of the judged figures by subject."""
    return validation.pages(SOURCES / "data/metrics")


def notebooks() -> list[Path]:
    """The notebooks, in their order."""
    return sorted((ROOT / "notebooks").glob("*.ipynb"))


def rooms() -> list[str]:
    """Folders of the package, each with a face that names what others may import."""
    return sorted(path.parent.name for path in (ROOT / "pipeline").glob("*/__init__.py"))


def reference(room: str) -> str:
    """Page of a room: what its face says, and its public modules."""
    face = ast.parse((ROOT / "pipeline" / room / "__init__.py").read_text(encoding="utf-8"))
    names = [
        name
        for node in face.body
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "__all__"
        for name in ast.literal_eval(node.value)
    ]
    modules = [name for name in names if (ROOT / "pipeline" / room / f"{name}.py").exists()]
    parts = [f"# {room}", ast.get_docstring(face) or ""]
    parts += [f"::: pipeline.{room}.{name}" for name in modules]
    return "\n\n".join(parts) + "\n"


def _filled(entry: Any) -> Any:
    """An entry of the navigation with made pages in the place of a folder."""
    ((title, target),) = entry.items()
    if target == "notebooks/":
        return {title: [{_question(p): f"notebooks/{p.stem}.md"} for p in notebooks()]}
    if target == "validation/":
        return {
            title: [{_heading(p): f"validation/{name}.md"} for name, p in validations().items()]
        }
    if target == "reference/":
        return {title: [{room: f"reference/{room}.md"} for room in rooms()]}
    if isinstance(target, list):
        return {title: [e for e in map(_filled, target) if _there(e)]}
    return entry


def _heading(page: str) -> str:
    return page.splitlines()[0].removeprefix("# Validation: ").capitalize()


def _question(path: Path) -> str:
    return notebook_pages.question(path)


def _there(entry: dict[str, Any]) -> bool:
    (target,) = entry.values()
    made = (*COPIES.values(), SETTINGS)
    return isinstance(target, list) or target in made or (ROOT / "docs" / target).exists()


def _pages(nav: list[Any]) -> list[str]:
    found = []
    for entry in nav:
        (target,) = entry.values()
        found += _pages(target) if isinstance(target, list) else [target]
    return found


def _relinked(text: str) -> str:
    """Links of a page of the root as links of a page in docs/."""
    text = re.sub(r"\]\(docs/", "](", text)
    return re.sub(r"\]\((README|CHANGELOG|CONTRIBUTING)\.md", _copied, text)


def _copied(found: re.Match[str]) -> str:
    return f"]({COPIES[found[1] + '.md']}"
