"""The sealed robots play the commands that they are given."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fimpact.benchmark.generator import reveal
from fimpact.support import tables
from fimpact.support.progress import logged

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with logged(snakemake.log[0]) as progress, np.load(snakemake.input.commands) as commands:
    played = reveal(Path(snakemake.input.sealed), dict(commands), snakemake.params.played, progress)
    tables.write_arrays(played, snakemake.output[0])
