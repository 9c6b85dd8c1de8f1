"""What others make of one case: the comparators, on the same held-out runs."""

from typing import TYPE_CHECKING

from fimpact.benchmark.comparators.compare_recording import compare_recording
from fimpact.cases import read_case
from fimpact.support import tables
from fimpact.support.progress import logged

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

params = snakemake.params

with logged(snakemake.log[0]) as progress:
    table = compare_recording(read_case(snakemake.input.case, params.data), params.limit, progress)
    tables.write(table, snakemake.output[0])
