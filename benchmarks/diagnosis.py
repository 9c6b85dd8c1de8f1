"""How long a diagnosis takes by this code, as a ratio to that of an earlier commit, of seconds of one processor.

python benchmarks/diagnosis.py COMMIT RECORDINGS [CASES]

RECORDINGS is the folder `recordings` of a blind benchmark (`snakemake concealed`), of which CASES (12) are drawn. Each
is diagnosed by either code in a process of its own, one right after the other: a computer's pace changes by the hour.
"""

import argparse
import os
import random
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
DIAGNOSE = """
import sys, time
from pathlib import Path
from fimpact.concealed.archive import load_recording
from fimpact.mismatch.diagnose import diagnose
recording = load_recording(Path(sys.argv[1]), sys.argv[2])
begun = time.process_time()
diagnose(recording)
print(time.process_time() - begun)
"""


def seconds(source: Path, case: Path) -> float:
    """Of the processor, for the diagnosis of `case` by the package in the folder `source`."""
    alone = os.environ | {"PYTHONPATH": str(source), "OMP_NUM_THREADS": "1"}
    ran = [sys.executable, "-c", DIAGNOSE, str(case.parent), case.name]
    return float(subprocess.run(ran, env=alone, capture_output=True, text=True, check=True).stdout.split()[-1])


def main() -> None:
    """A line for each case, and the ratio over all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("commit")
    parser.add_argument("recordings", type=Path)
    parser.add_argument("cases", nargs="?", type=int, default=12)
    given = parser.parse_args()
    found = sorted(path for path in given.recordings.glob("*/*") if path.is_dir())
    with tempfile.TemporaryDirectory() as folder:
        tree = subprocess.run(["git", "archive", given.commit, "src"], cwd=ROOT, capture_output=True, check=True).stdout
        subprocess.run(["tar", "x", "-C", folder], input=tree, check=True)
        total = [0.0, 0.0]
        for case in random.Random(0).sample(found, min(given.cases, len(found))):
            took = [seconds(Path(folder) / "src", case), seconds(ROOT / "src", case)]
            total = [sum(pair) for pair in zip(total, took, strict=True)]
            print(f"{case.name}: {took[0]:.1f} s then, {took[1]:.1f} s now", flush=True)
    print(f"all: {total[1] / total[0]:.2f} of {total[0]:.0f} s")


if __name__ == "__main__":
    main()
