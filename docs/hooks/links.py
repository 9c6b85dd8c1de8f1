"""Links between files of the repository as links between pages of the site."""

import posixpath
import re
from collections.abc import Mapping
from pathlib import Path

from mkdocs.structure.files import Files

LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\((?!https?:|#|mailto:)([^)#\s]+)(#[^)\s]*)?\)")
FENCED = re.compile(r"^```.*?^```", re.S | re.M)
PICTURES = (".png", ".gif", ".svg")


def pictures(root: Path, beside: Mapping[str, str], files: Files) -> dict[str, Path]:
    """Pictures outside of the folder of the documentation that a page shows, by their name on the site."""
    pages = {f"docs/{file.src_uri}": file.content_string for file in files.documentation_pages()}
    pages |= {source: (root / source).read_text("utf-8") for source in beside.values()}
    found = {}
    for source, text in pages.items():
        for _, _, target, _ in LINK.findall(text):
            path = _of_repository(source, target)
            if path.endswith(PICTURES) and (root / path).is_file() and not path.startswith("docs/"):
                found[_on_site(path)] = root / path
    return found


def rewritten(text: str, source: str, page: str, beside: Mapping[str, str], files: Files) -> str:
    """The Markdown `text` of the file `source`, which is shown as `page`; what is no page becomes plain code."""
    pages = {name: site for site, name in beside.items()}

    def link(found: re.Match[str]) -> str:
        picture, words, target, anchor = found[1], found[2], found[3], found[4] or ""
        path = _of_repository(source, target)
        here = posixpath.dirname(page)
        if path in pages:
            return f"{picture}[{words}]({posixpath.relpath(pages[path], here)}{anchor})"
        if path.endswith(PICTURES) and path.startswith("docs/"):
            return found[0]
        if path.endswith(PICTURES):
            return f"{picture}[{words}]({posixpath.relpath(_on_site(path), here)})"
        site = (
            path.removeprefix("docs/")
            .replace(".ipynb", ".md")
            .replace("examples/from_frames.py", "examples/from_frames.md")
        )
        if path.startswith("docs/") and files.get_file_from_path(site):
            return f"{picture}[{words}]({posixpath.relpath(site, here)}{anchor})"
        return words if words.startswith("`") else f"{words} (`{path}`)"

    parts, at = [], 0
    for block in FENCED.finditer(text):
        parts += [LINK.sub(link, text[at : block.start()]), block[0]]
        at = block.end()
    return "".join([*parts, LINK.sub(link, text[at:])])


def _of_repository(source: str, target: str) -> str:
    return posixpath.normpath(posixpath.join(posixpath.dirname(source), target))


def _on_site(path: str) -> str:
    return path if path.startswith("assets/") else "assets/" + path.removeprefix("docs/").replace("/", "-")
