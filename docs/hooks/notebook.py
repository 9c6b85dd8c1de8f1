"""The tutorial: run, and shown with what it printed and drew."""

from pathlib import Path

import nbformat
from nbclient import NotebookClient
from nbconvert import MarkdownExporter

SECONDS = 120  # of a cell


def page(path: Path) -> dict[str, str | bytes]:
    """Run the notebook, and give its page and its pictures.

    Raises:
        nbclient.exceptions.CellExecutionError: a cell fails.
    """
    notebook = nbformat.read(path, as_version=4)
    NotebookClient(notebook, timeout=SECONDS, kernel_name="python3").execute()
    text, resources = MarkdownExporter().from_notebook_node(notebook, {"output_files_dir": "tutorial"})
    return {"tutorial.md": text, **resources["outputs"]}
