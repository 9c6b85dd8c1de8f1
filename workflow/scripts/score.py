"""The seals opened, their hashes checked, and answers held against what was planted."""

from pathlib import Path
from typing import TYPE_CHECKING

from fimpact.benchmark.grading.score import score_part
from fimpact.benchmark.jsonl import as_lines
from fimpact.support import atomic_files
from fimpact.support.progress import logged

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

files = snakemake.input

with logged(snakemake.log[0]) as progress:
    told = {stage: Path(files[stage]) for stage in ("conceal", "diagnosis", "resolved", "peers")}
    rows = score_part(Path(files.recordings), Path(files.sealed), told, snakemake.params.entered, progress)
    atomic_files.write_text(as_lines(rows), snakemake.output[0])
