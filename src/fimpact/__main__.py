"""Run the command `fimpact` as ``python -m fimpact``."""

import sys

from fimpact.cli import main

sys.exit(main())
