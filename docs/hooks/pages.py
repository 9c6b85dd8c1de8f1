"""Pages that are made when the site is built: effects, the tutorial, and those that stand beside what they explain."""

import re
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import effects
import formulas
import links
import notebook
import rigs
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[2]
BESIDE = {  # page of the site -> the file of the repository that it shows
    "case-files.md": "src/fimpact/cases/keys.md",
    "rigs-data.md": "config/recordings/README.md",
    "configuration.md": "config/README.md",
    "paper-figures.md": "results/reference/paper/README.md",
    "benchmark-lines.md": "results/reference/concealed/README.md",
    "rigs-one-by-one.md": "results/reference/recordings/README.md",
    "changes.md": "CHANGELOG.md",
}


def on_files(files: Files, config) -> Files:
    """Add the pages that are made."""
    made: dict[str, str | bytes] = {page: _indented(ROOT / source) for page, source in BESIDE.items()}
    made |= effects.pages()
    made |= notebook.page(ROOT / "docs" / "tutorial.ipynb")
    made["examples/from_frames.md"] = _code(ROOT / "docs" / "examples" / "from_frames.py")
    for name, content in made.items():
        files.append(File.generated(config, name, content=content))
    for name, path in links.pictures(ROOT, BESIDE, files).items():
        files.append(File.generated(config, name, abs_src_path=str(path)))
    return files


def on_page_markdown(markdown: str, page, config, files: Files) -> str:
    """Turn links to files of the repository into links of the site."""
    source = BESIDE.get(page.file.src_uri, f"docs/{page.file.src_uri}")
    markdown = rigs.apart(markdown)
    return links.rewritten(markdown, source, page.file.src_uri, BESIDE, files)


def on_page_content(html: str, page, config, files: Files) -> str:
    """Set formulas as MathML, which browsers show by themselves."""
    return formulas.as_mathml(html)


def _indented(path: Path) -> str:
    """The page, with pictures of a list as far inside as Python's Markdown wants them."""
    return re.sub(r"^  (?=!\[)", "    ", path.read_text("utf-8"), flags=re.M)


def _code(path: Path) -> str:
    return f"# {path.name}\n\n```python\n{path.read_text('utf-8')}```\n"
