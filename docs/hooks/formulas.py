"""Formulas as MathML: no script, and nothing from another host."""

import html
import re

from latex2mathml.converter import convert

MARKED = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', re.S)


def as_mathml(text: str) -> str:
    """Convert what arithmatex has marked."""
    return MARKED.sub(_converted, text)


def _converted(found: re.Match[str]) -> str:
    return convert(html.unescape(found[3]).strip(), display="block" if found[2] == "[" else "inline")
