"""Write concealed cases of simulated rigs, and check that each can be read.

python benchmarks/rigs/make.py OUT --seed N [--only servo_arm,hopping_leg,exact_coulomb,torque_arm]

Each case is a folder: case.yaml, model.xml (the naive model), logs of which the last is held out, and truth.json, which
is for whoever marks the answers.
"""

import argparse
import subprocess
import sys
import time
from pathlib import Path

import exact_coulomb
import hopping_leg
import servo_arm
import torque_arm
from folder import write

RIGS = {rig.__name__: rig for rig in (servo_arm, hopping_leg, exact_coulomb, torque_arm)}


def check(case: Path) -> str:
    """What `fimpact check` says of a case file; exits where it refuses it."""
    asked = [sys.executable, "-m", "fimpact.cli", "check", str(case)]
    done = subprocess.run(asked, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(done.stderr.strip())
    return done.stdout.splitlines()[0]


def main() -> None:
    """Make, write and check what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, metavar="OUT")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default=",".join(RIGS))
    options = parser.parse_args()
    wanted = options.only.split(",")
    if unknown := set(wanted) - set(RIGS):
        raise SystemExit(f"no rig is called {', '.join(sorted(unknown))}; there are {', '.join(RIGS)}")
    for rig in wanted:
        began = time.monotonic()
        for name, made in RIGS[rig].make(options.seed).items():
            print(check(write(made, options.out / name)), flush=True)
        print(f"{rig}: {time.monotonic() - began:.0f} s", flush=True)


if __name__ == "__main__":
    main()
