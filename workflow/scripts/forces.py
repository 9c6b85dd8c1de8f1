"""Planned contact forces over time, beside MuJoCo's."""

from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd

from fimpact.paper.figures import forces
from fimpact.support import tables
from fimpact.support.progress import logged

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

files, output = snakemake.input, snakemake.output

with logged(snakemake.log[0]):
    plans, parts = (pd.concat(tables.read(path) for path in part) for part in (files.plans, files.forces))
    tables.write(plans, output.plans)
    forces.draw(parts, plans, Path(output.svg).with_suffix(""))
