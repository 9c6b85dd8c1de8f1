"""Files and folders of measured data as named columns: which reader serves which. Nothing here runs code of a file.

Text is in `texts`, Parquet in `arrow_tables`, arrays of NumPy and MATLAB in `arrays`, bags of ROS in `ros`, datasets of
LeRobot in `lerobot`.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from fimpact.cases.errors import CaseError, listed, summarise_exception
from fimpact.cases.readers import arrays, arrow_tables, lerobot, ros, texts
from fimpact.cases.readers.columns import Table, narrow


def read_table(path: Path) -> Table:
    """Every column of a file or folder; the ending of its name, or what is in the folder, says the format.

    Raises:
        CaseError: no such file, unknown format, or a file that is damaged or holds pickled objects.
    """
    kind, reader = _reader(path)
    if not path.exists():
        raise CaseError(f"data file {path} does not exist; put it there, correct `file`, or point to it with --data")
    try:
        where = str(path.resolve())
        return [replace(one, origin=(where, one.group, one.name)) for one in narrow(reader(path), path)]
    except CaseError:
        raise
    except Exception as error:
        raise CaseError(
            f"data file {path} cannot be read as {kind}: {summarise_exception(error)}; "
            "it may be damaged or of another format; write it again"
        ) from None


def files_of(path: Path) -> list[Path]:
    """List the files that are read of a data file or folder."""
    if not path.is_dir():
        return [path]
    patterns = ("meta/info.json", "data/**/*.parquet", "metadata.yaml", "*.mcap", "*.db3")
    return [file for pattern in patterns for file in sorted(path.glob(pattern))]


def _reader(path: Path) -> tuple[str, Callable[[Path], Table]]:
    if path.is_dir():
        if (path / "meta" / "info.json").is_file():
            return "a LeRobot dataset", lerobot.dataset
        if (path / "metadata.yaml").is_file():
            return "a ROS 2 bag", ros.bag
        raise CaseError(
            f"data folder {path} has neither meta/info.json (LeRobot) nor metadata.yaml (ROS 2 bag); allowed: one of "
            "these, or a file; name the file in it that is meant"
        )
    readers = dict.fromkeys((".csv", ".txt", ".tsv"), texts.csv)
    readers |= dict.fromkeys((".jsonl", ".ndjson", ".json"), texts.json_lines)
    readers |= {".parquet": arrow_tables.parquet, ".npy": arrays.npy, ".npz": arrays.npz, ".mat": arrays.mat}
    readers |= dict.fromkeys((".mcap", ".db3", ".bag"), ros.bag)
    ending = path.suffix.lower()
    if ending not in readers:
        raise CaseError(
            f"data file {path} is of an unknown format; {listed(readers, ending)}, a LeRobot dataset or a ROS 2 bag "
            "(folders); convert it"
        )
    return ending[1:], readers[ending]
