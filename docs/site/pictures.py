"""Pictures of the documentation, taken from the build that they show.

``python docs/site/pictures.py`` takes those of the active fleet from ``reports/`` and from the
pages of the tutorial's commands, with the Chromium on the path, and writes them to docs/pictures/
beside ``pictures.json``: of each its page, its machine, and digests of picture, page and key
figures, by which a test knows when it has become stale.
"""

import argparse
import html
import json
import re
import shlex
import shutil
import subprocess
import sys
from hashlib import sha256
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import yaml
from PIL import Image

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "docs/pictures"
INDEX = FOLDER / "pictures.json"
WIDTH_PX = 1180
COLOURS = 64
ATTEMPTS = 4
TEXT_SHOWN = 600
"""Characters of a page's text that count as shown: its head, its verdict, its first figures."""
PART = (
    "data/raw/mill00/parts/O5181.nc --machine mill00 --stock box:0,80,0,60,-15,0 "
    "--tool-table mill01 --material A7075 --limit-load 450"
)


class Picture(NamedTuple):
    """A picture of the top of a page."""

    fleet: str
    machine: str
    page: str
    """File in reports/, or the name of the page that ``command`` writes."""
    height_px: int
    figures: str
    """Pattern of the files in data/metrics that the page shows."""
    command: str = ""


PICTURES = {
    "report": Picture("recorded", "mazak01", "mazak01.html", 1180, "mazak01_*"),
    "spindle": Picture("recorded", "mazak01", "mazak01_spindle.html", 1100, "mazak01_spindle"),
    "control": Picture("recorded", "hurco", "hurco_control.html", 1100, "hurco_control"),
    "drives": Picture("recorded", "emps", "emps_drive.html", 1100, "emps_drive"),
    "following_residual": Picture(
        "recorded", "emps", "emps_following_residual.html", 1100, "emps_following*"
    ),
    "forces": Picture("recorded", "kistler_slot", "kistler_slot_cutting.html", 1100, "kistler_*"),
    "fleet": Picture("demo", "mill00", "index.html", 620, "mill00_*"),
    "machine": Picture("demo", "mill00", "mill00.html", 1180, "mill00_*"),
    "cut": Picture("demo", "mill00", "cut.html", 1100, "mill00_cutting",
                   f"simulate {PART} --page"),
    "optimised": Picture("demo", "mill00", "faster.html", 1100, "mill00_optimise",
                         f"optimise {PART} --feed 50 8000 --speed 1000 12000 --page"),
    "growth": Picture("simulated", "mill01", "mill01_deformation.html", 1100, "mill01_deformation"),
    "wear": Picture("simulated", "mill01", "mill01_wear.html", 1100, "mill01_wear"),
    "tools": Picture("simulated", "mill01", "mill01.html", 1180, "mill01_*"),
    "synthesis": Picture("simulated", "mill01", "mill01_synthesis.html", 1100, "mill01_synthesis"),
}  # fmt: skip


def figures_digest(metrics: Path, pattern: str) -> str:
    """Digest of key figures, to the three digits that a page shows."""
    paths = sorted(metrics.glob(f"{pattern}.json"))
    found = {path.stem: _rounded(json.loads(path.read_text())) for path in paths}
    return sha256(json.dumps(found, sort_keys=True).encode()).hexdigest()[:16]


def text_digest(page: Path) -> str:
    """Digest of the text at the top of a page."""
    body = page.read_text(encoding="utf-8").split("<body", 1)[-1]
    plain = re.sub(r"<(style|script).*?</\1>|<[^>]+>", " ", body, flags=re.DOTALL)
    shown = " ".join(html.unescape(plain).split())[:TEXT_SHOWN]
    return sha256(shown.encode()).hexdigest()[:16]


def picture_digest(picture: Path) -> str:
    """Digest of a picture's file."""
    return sha256(picture.read_bytes()).hexdigest()[:16]


def take(project: Path, reports: Path) -> list[str]:
    """Take the pictures of the project's active fleet; their names."""
    fleet = yaml.safe_load((project / "conf/fleet/active.yaml").read_text())["name"]
    index = json.loads(INDEX.read_text()) if INDEX.exists() else {}
    taken = {name: shown for name, shown in PICTURES.items() if shown.fleet == fleet}
    with TemporaryDirectory() as place:
        for name, shown in taken.items():
            page = _page(shown, project, reports, Path(place))
            picture = FOLDER / f"{name}.png"
            _photograph(page, picture, shown.height_px, Path(place) / name)
            index[name] = _entry(shown, page, picture, project / "data/metrics")
    INDEX.write_text(json.dumps(dict(sorted(index.items())), indent=1) + "\n")
    return list(taken)


def _page(shown: Picture, project: Path, reports: Path, place: Path) -> Path:
    if not shown.command:
        if not (reports / shown.page).exists():
            raise SystemExit(f"{reports / shown.page} does not exist: build the fleet first")
        return reports / shown.page
    page = place / shown.page
    words = [sys.executable, "-m", "pipeline.app", *shlex.split(shown.command), page]
    out = ["--out", place / "part.nc"] if shown.command.startswith("optimise") else []
    subprocess.run([*words, *out], cwd=project, check=True, stdout=subprocess.DEVNULL)
    return page


def _photograph(page: Path, picture: Path, height_px: int, profile: Path) -> None:
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    if chromium is None:
        raise SystemExit("no chromium is on the path: install it to take pictures")
    raw = profile.with_suffix(".png")
    for attempt in range(ATTEMPTS):  # headless Chromium now and then ends without a picture
        _screenshot(chromium, page, raw, height_px, Path(f"{profile}-{attempt}"))
        if raw.exists():
            break
    else:
        raise SystemExit(f"{chromium} wrote no picture of {page} in {ATTEMPTS} attempts")
    packed = BytesIO()
    Image.open(raw).convert("RGB").quantize(COLOURS).save(packed, "PNG", optimize=True)
    picture.write_bytes(packed.getvalue())


def _screenshot(chromium: str, page: Path, raw: Path, height_px: int, profile: Path) -> None:
    subprocess.run(
        [chromium, "--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage",
         "--disable-background-networking",
         "--disable-component-update", "--disable-sync", "--no-first-run", "--hide-scrollbars",
         f"--user-data-dir={profile}", f"--window-size={WIDTH_PX},{height_px}",
         f"--screenshot={raw}", page.resolve().as_uri()],
        check=True, capture_output=True,
    )  # fmt: skip


def _entry(shown: Picture, page: Path, picture: Path, metrics: Path) -> dict[str, str]:
    return {
        "machine": shown.machine,
        "page": shown.page,
        "picture": picture_digest(picture),
        "text": text_digest(page),
        "figures": figures_digest(metrics, shown.figures),
    }


def _rounded(value: Any) -> Any:
    if isinstance(value, float):
        return f"{value:.3g}"
    if isinstance(value, dict):
        return {key: _rounded(inner) for key, inner in value.items()}
    return [_rounded(inner) for inner in value] if isinstance(value, list) else value


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Take the pictures of the active fleet.")
    parser.add_argument("--project", type=Path, default=ROOT, help="built project")
    parser.add_argument("--reports", type=Path, help="its report; reports/ of the project")
    words = parser.parse_args()
    for name in take(words.project, words.reports or words.project / "reports"):
        sys.stdout.write(f"wrote {FOLDER / name}.png\n")
