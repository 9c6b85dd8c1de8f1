"""The slow comparators, on their share of the cases."""

from pathlib import Path
from typing import TYPE_CHECKING

from fimpact.concealed.peers import compare_part
from fimpact.concealed.rows import as_lines
from fimpact.support import drafts
from fimpact.support.progress import logged

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with logged(snakemake.log[0]) as progress:
    params = snakemake.params
    rows = compare_part(Path(snakemake.input.recordings), params.compared, params.refitted, progress)
    drafts.write_text(as_lines(rows), snakemake.output[0])
