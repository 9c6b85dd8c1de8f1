"""README and the pages: short, linked, and with the same figures."""

import re
from pathlib import Path

import pandas as pd
import pytest
import yaml
from conftest import ROOT

PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
LINK = re.compile(r"\]\((?!https?:|#|mailto:)([^)#\s]+)(?:#[^)\s]*)?\)")
FENCED = re.compile(r"^```.*?^```", re.S | re.M)


def rows(text: str) -> list[list[str]]:
    """Cells of every row of a Markdown table."""
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line.startswith("|")]


def test_readme_is_short_and_has_the_command_of_the_tests():
    text = (ROOT / "README.md").read_text()
    assert len(text.splitlines()) <= 130 and text.count("<!-- test command -->\n```bash\n") == 1


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path):
    for target in LINK.findall(FENCED.sub("", page.read_text())):
        made = {"effects.md", "tutorial.md"} if page.parent.name == "docs" else set()  # when the site is built
        assert (page.parent / target).exists() or target in made, f"{page.name}: {target}"


def test_readme_has_the_figures_of_the_benchmark_page():
    (table,) = re.findall(r"\| what \| bar \|.*?\n\n", (ROOT / "README.md").read_text(), re.S)
    page = (ROOT / "docs" / "benchmark.md").read_text().replace(" %", "")
    for _, _, measured, cases in rows(table)[2:]:
        assert measured.replace(" %", "") in page and re.search(rf"\b{cases}\b", page)


def test_readme_has_the_figures_of_the_paper_page():
    text = (ROOT / "README.md").read_text()
    table = (ROOT / "docs" / "paper.md").read_text().split("<!-- /summary -->")[0]  # an earlier one stands below
    shown = {tuple(row[:2]): row[2].split(" (")[0] for row in rows(table)}
    for system, method in (("arm", "fisher"), ("arm", "uniform"), ("block", "fisher"), ("block", "uniform")):
        assert shown[system, method] in text


def test_readme_has_the_figures_of_the_rig():
    (row,) = (row for row in rows((ROOT / "docs" / "rigs.md").read_text()) if row[0] == "emps")
    assert "friction 20.4 ± 1 N" in row[-1] and "damping 205 ± 10 N s/m" in row[-1]
    assert "it finds 20.4 ± 1 and 205 ± 10" in (ROOT / "README.md").read_text()


def test_every_page_is_in_the_menu():
    menu = re.search(r"^nav:.*", (ROOT / "mkdocs.yml").read_text(), re.S | re.M)[0]
    listed = re.findall(r": (\S+\.md)$", menu, re.M)
    assert {page.name for page in PAGES if page.parent.name == "docs"} <= set(listed) and yaml.safe_load(menu)


def test_the_printed_reader_reads(tmp_path):
    (text,) = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "add-reader.md").read_text(), re.S)
    names: dict = {}
    exec(text, names)
    pd.DataFrame({"t": [0.0, 0.1], "q": [1.0, 2.0]}).to_feather(tmp_path / "log.feather")
    assert [(one.name, one.values.tolist()) for one in names["feather"](tmp_path / "log.feather")] == [
        ("t", [0.0, 0.1]),
        ("q", [1.0, 2.0]),
    ]
