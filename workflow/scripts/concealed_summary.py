"""Every line of the claim, with its interval."""

from typing import TYPE_CHECKING

from fimpact.benchmark.grading import case_table, claim
from fimpact.benchmark.grading.strata import strata, track_record
from fimpact.support import atomic_files, tables
from fimpact.support.progress import logged

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with logged(snakemake.log[0]):
    cases = case_table.read_cases(snakemake.input.cases)
    tables.write(claim.to_table(cases), snakemake.output.table)
    tables.write(strata(cases), snakemake.output.strata)
    tables.write(track_record(cases), snakemake.output.record)
    atomic_files.write_text(claim.to_markdown(cases), snakemake.output.text)
