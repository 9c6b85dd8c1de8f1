"""One of the benchmark's pictures."""

from pathlib import Path
from typing import TYPE_CHECKING

from fimpact.benchmark.grading import case_table, pictures
from fimpact.support.progress import logged

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with logged(snakemake.log[0]):
    draw = pictures.FIGURES[snakemake.wildcards.figure]
    draw(case_table.read_cases(snakemake.input.cases), Path(snakemake.output.svg).with_suffix(""))
