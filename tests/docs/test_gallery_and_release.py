"""The gallery holds every picture; what a release promises agrees with the package."""

import re
import tomllib

from helpers.robots import ROOT

DOCS = ROOT / "docs"
ENTRIES = tomllib.loads((DOCS / "gallery.toml").read_text(encoding="utf-8"))["entry"]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def test_every_picture_and_figure_is_in_the_gallery_with_its_page() -> None:
    pictures = {each["picture"] for each in ENTRIES if "picture" in each}
    assert pictures == {path.stem for path in (DOCS / "pictures").iterdir()}
    source = "".join(path.read_text(encoding="utf-8") for path in (DOCS / "_figures").glob("*.py"))
    assert {each["drawn"] for each in ENTRIES if "drawn" in each} == set(re.findall(r"@drawn\ndef (\w+)", source))
    for each in ENTRIES:
        page = (DOCS / f"{each['page']}.md").read_text(encoding="utf-8")
        assert each.get("picture", each.get("drawn", "")) in page, each
        script = re.search(r"scripts/[\w/]+\.py", each.get("command", ""))
        assert script is None or (ROOT / script[0]).exists()


def test_the_links_of_llms_txt_lead_to_pages() -> None:
    links = re.findall(r"\]\(([^)]+)\)", (DOCS / "llms.txt").read_text(encoding="utf-8"))
    assert links
    for link in links:
        assert (DOCS / link).with_suffix(".md").exists(), link


def test_the_lowest_pins_are_those_that_the_package_admits() -> None:
    pins = dict(
        line.split("==") for line in (ROOT / ".ci" / "lowest.txt").read_text().splitlines() if not line.startswith("#")
    )
    admitted = {re.split("[><=]", each)[0]: re.search(r">=([\d.]+)", each)[1] for each in PROJECT["dependencies"]}
    assert set(pins) == set(admitted)
    for name, lowest in admitted.items():
        assert pins[name].split(".")[: len(lowest.split("."))] == lowest.split("."), name


def test_version_citation_and_changelog_agree() -> None:
    import lab

    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"version: {lab.__version__}" in citation
    assert f"## {lab.__version__}" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
