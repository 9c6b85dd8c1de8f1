"""Every line of the claim, with its interval."""

from typing import TYPE_CHECKING

from fimpact.concealed import measures
from fimpact.concealed.strata import strata, track_record
from fimpact.support import drafts, tables
from fimpact.support.progress import logged

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with logged(snakemake.log[0]):
    cases = measures.read_cases(snakemake.input.cases)
    tables.write(measures.to_table(cases), snakemake.output.table)
    tables.write(strata(cases), snakemake.output.strata)
    tables.write(track_record(cases), snakemake.output.record)
    drafts.write_text(measures.to_markdown(cases), snakemake.output.text)
