"""What exported files predict, to be held to what the package predicts."""

import numpy as np

from fimpact.export.improved_model import Predicted, write_files
from fimpact.export.replay import Replay
from fimpact.recordings import Recording
from fimpact.simulation.hypothesis import Hypothesis


def replayed(given: Recording, hypothesis: Hypothesis, predicted: Predicted, folder) -> np.ndarray:
    """The same windows by the files that are written, without a choice of numerics."""
    write_files(given, hypothesis, folder, "found", None, 0)
    lagging = any(p.effect.enters == "command" for p in hypothesis.placed)
    return Replay(given, folder, lagging).predict(*predicted[:4])
