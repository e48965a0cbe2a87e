"""Pages as a browser shows and prints them."""

import json
import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from helpers.html_page import Page

pytestmark = pytest.mark.figures

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
LOOK = """<script>
const told = {wide: document.documentElement.scrollWidth, room: document.documentElement.clientWidth};
told.figures = [...document.querySelectorAll("figure")].map(figure => figure.id);
told.sizes = [...document.querySelectorAll("figure svg")].map(svg => {
  const box = svg.getBoundingClientRect();
  const text = [...svg.querySelectorAll("text")].map(each => each.getBoundingClientRect());
  const out = text.filter(t => t.left < box.left - 1 || t.right > box.right + 1 || t.bottom > box.bottom + 1);
  return [box.width, box.height, svg.querySelectorAll("path").length, text.length, out.length];
});
const kept = document.createElement("pre");
kept.id = "told";
kept.textContent = JSON.stringify(told);
document.body.append(kept);
</script>"""


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    """Opens a page in a headless Chromium with a home of its own; its output, and what its console says."""
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    if found is None:
        pytest.skip(f"no Chromium here ({', '.join(BROWSERS)}): the pages are not opened")
    home = tmp_path_factory.mktemp("home")

    def opened(path: Path, *flags: str) -> tuple[str, list[str]]:
        alone = (f"--user-data-dir={home}", "--host-resolver-rules=MAP * ~NOTFOUND", "--enable-logging=stderr")
        command = [found, "--headless=new", "--no-sandbox", "--disable-gpu", *alone, *flags, path.as_uri()]
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=60, check=True, env=os.environ | {"HOME": str(home)}
        )
        return done.stdout, [line for line in done.stderr.splitlines() if "CONSOLE" in line]

    return opened


@pytest.fixture
def pages(drawn_run: Path, drawn_plan: Path, drawn_study: Path) -> dict[str, Path]:
    """The pages of runs by their names."""
    return {folder.name: folder / "report.html" for folder in (drawn_run, drawn_plan, drawn_study)}


@pytest.mark.thorough
@pytest.mark.parametrize(("name", "width"), [("run", 1100), ("run", 500), ("plan", 500), ("study", 1100)])
def test_a_browser_shows_every_figure(name: str, width: int, pages: dict[str, Path], browser, tmp_path: Path) -> None:
    """On a desk and on a phone: no complaint, every picture has its size, no text is cut off, nothing scrolls aside."""
    whole = pages[name].read_text(encoding="utf-8")
    copy = tmp_path / "report.html"
    copy.write_text(whole.replace("</body>", f"{LOOK}</body>"), encoding="utf-8")
    dom, said = browser(copy, f"--window-size={width},900", "--dump-dom")
    told = json.loads(re.search(r'<pre id="told">(.*?)</pre>', dom)[1])
    assert not said and told["wide"] <= told["room"]
    assert told["figures"] == list(Page(pages[name]).figures)
    for wide, high, paths, texts, cut in told["sizes"]:
        assert wide > 0.6 * min(width, 480) and high > 25 and paths > 4 and texts > 3 and cut == 0


@pytest.mark.thorough
def test_it_prints(pages: dict[str, Path], browser, tmp_path: Path) -> None:
    for name, most in (("run", 8), ("plan", 4)):
        pdf = tmp_path / f"{name}.pdf"
        _, said = browser(pages[name], "--no-pdf-header-footer", f"--print-to-pdf={pdf}")
        count = len(re.findall(rb"/Type\s*/Page\b", pdf.read_bytes()))
        assert not said and pdf.read_bytes().startswith(b"%PDF") and 2 <= count <= most
