"""The table of the rigs in two: a page is too narrow for figures and sentences side by side."""

import re

TABLE = re.compile(r"(?<=<!-- recordings -->\n).*?(?=<!-- /recordings -->)", re.S)


def apart(text: str) -> str:
    """Take the last column of the table, what is said, out into a table of its own."""
    return TABLE.sub(lambda found: _split(found[0]), text)


def _split(table: str) -> str:
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in table.strip().splitlines()]
    figures = "".join(f"| {' | '.join(row[:-1])} |\n" for row in rows)
    said = "".join(f"| {row[0]} | {row[-1]} |\n" for row in rows)
    return f"\n{figures}\n{said}\n"
