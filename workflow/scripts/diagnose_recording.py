"""What the model of one case lacks: the page, and all that belongs to it."""

from pathlib import Path
from typing import TYPE_CHECKING

from fimpact.api.commands.diagnose_recording import diagnose_recording
from fimpact.support.progress import logged

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

files = snakemake.input

with logged(snakemake.log[0]) as progress:
    found, _ = diagnose_recording(files.case, snakemake.params.data, Path(snakemake.output.page).parent, progress)
    progress(found.verdict)
