"""Tables are written whole or not at all, and do not depend on how the work was split."""

import os

import numpy as np
import pandas as pd
import pytest

from fimpact.support import progress, tables


def rows(system: str, method: str, seeds: list[int]) -> pd.DataFrame:
    keys = [(system, method, seed, turn, name) for seed in seeds for turn in (0, 1) for name in ("width", "height")]
    table = pd.DataFrame(keys, columns=["system", "method", "seed", "round", "parameter"])
    return table.assign(value=table.seed / 3)


@pytest.mark.parametrize("split", [[[2, 10, 1]], [[1], [10], [2]], [[10, 2], [1]]])
def test_gather_does_not_depend_on_the_split(tmp_path, split):
    parts = []
    for system, method in (("block", "uniform"), ("arm", "uniform"), ("block", "fisher"), ("arm", "fisher")):
        for seeds in split:
            parts.append(tmp_path / f"{system}-{method}-{seeds[0]}.csv")
            tables.write(rows(system, method, seeds), parts[-1])
    got = tables.gather(parts, ["block", "arm"], ["fisher", "uniform"])
    listed = (("block", "fisher"), ("block", "uniform"), ("arm", "fisher"), ("arm", "uniform"))
    want = pd.concat([rows(*key, [1, 2, 10]) for key in listed], ignore_index=True)
    pd.testing.assert_frame_equal(got, want, check_dtype=False, rtol=1e-8)


def test_gathered_numbers_are_those_of_the_parts(tmp_path):
    tables.write(rows("arm", "fisher", [1]), tmp_path / "part.csv")
    tables.write(tables.gather([tmp_path / "part.csv"], ["arm"], ["fisher"]), tmp_path / "whole.csv")
    assert (tmp_path / "whole.csv").read_text() == (tmp_path / "part.csv").read_text()
    assert "0.333333333\n" in (tmp_path / "part.csv").read_text()


class Unprintable:
    """A value that breaks the write half way."""

    def __str__(self):
        raise RuntimeError


def test_a_write_that_fails_leaves_the_old_file_and_no_litter(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("old")
    table = pd.DataFrame({"good": [1.0], "bad": [Unprintable()]})
    with pytest.raises(RuntimeError):
        tables.write(table, path)
    assert [p.name for p in tmp_path.iterdir()] == ["table.csv"]
    assert path.read_text() == "old"


def test_arrays_come_back(tmp_path):
    tables.write_arrays({"designs": np.arange(3.0)}, tmp_path / "a.npz")
    assert np.load(tmp_path / "a.npz")["designs"].tolist() == [0, 1, 2]


def test_progress_reaches_terminal_and_log_at_once(tmp_path, capsys):
    with progress.logged(tmp_path / "log") as report:
        report("arm fisher: 1 of 2 seeds")
        assert (tmp_path / "log").read_text() == "arm fisher: 1 of 2 seeds\n"
        assert capsys.readouterr().err == "arm fisher: 1 of 2 seeds\n"


def test_a_failure_lands_in_the_log(tmp_path):
    with pytest.raises(SystemExit), progress.logged(tmp_path / "log"):
        raise FloatingPointError("not finite")
    assert "FloatingPointError: not finite" in (tmp_path / "log").read_text()


def test_a_job_stops_when_snakemake_is_gone(tmp_path, monkeypatch):
    with progress.logged(tmp_path / "log") as report:
        monkeypatch.setattr(os, "getppid", lambda: 1)
        with pytest.raises(SystemExit, match="snakemake is gone"):
            report("never seen")
    assert "never seen" not in (tmp_path / "log").read_text()
