"""A published file is put in its place whole and unaltered, or not at all."""

import hashlib
from collections.abc import Iterator

import pytest
import yaml
from conftest import ROOT
from web_server import CONTENT, serving

from fimpact.support.fetch import Source, fetch, find_source, read_sources

SHA = hashlib.sha256(CONTENT).hexdigest()


@pytest.fixture(scope="module")
def server(tmp_path_factory) -> Iterator[str]:
    """Address of a local server that has one file, log.bin."""
    with serving(tmp_path_factory.mktemp("served")) as address:
        yield address


def test_the_right_file_is_put_in_its_place(server, tmp_path):
    fetch(Source("log.bin", f"{server}/log.bin", SHA, "MIT"), tmp_path / "rig" / "log.bin")
    assert (tmp_path / "rig" / "log.bin").read_bytes() == CONTENT
    assert [path.name for path in (tmp_path / "rig").iterdir()] == ["log.bin"]


@pytest.mark.parametrize(
    ("name", "sha", "words"),
    [
        ("log.bin", "0" * 64, ["not the one expected", "0" * 64, "nothing was kept"]),
        ("none.bin", SHA, ["answers 404", "by hand"]),
    ],
)
def test_what_is_wrong_leaves_nothing_and_gets_one_line(server, tmp_path, name, sha, words):
    with pytest.raises(ValueError, match=name) as error:
        fetch(Source(name, f"{server}/{name}", sha, "MIT"), tmp_path / "rig" / name)
    assert "\n" not in str(error.value) and all(word in str(error.value) for word in words)
    assert not list((tmp_path / "rig").glob("*"))


def test_a_server_that_is_not_there_gets_one_line(tmp_path):
    with pytest.raises(ValueError, match="cannot be reached") as error:
        fetch(Source("log.bin", "http://127.0.0.1:9/log.bin", SHA, "MIT"), tmp_path / "log.bin")
    assert "\n" not in str(error.value) and not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ({"file": "../escape"}, ["[0].file", "inside the data folder"]),
        ({"file": "/etc/passwd"}, ["[0].file", "inside the data folder"]),
        ({"url": "ftp://a/b"}, ["[0].url", "http"]),
        ({"sha256": "abc"}, ["[0].sha256", "64 hex digits"]),
        ({"license": "MIT"}, ["license is not a key", "did you mean 'licence'"]),
    ],
)
def test_a_mistake_in_the_table_gets_one_line(tmp_path, row, words):
    good = {"file": "a/b", "url": "https://a/b", "sha256": SHA, "licence": "MIT"}
    (tmp_path / "sources.yaml").write_text(yaml.safe_dump([good | row]))
    with pytest.raises(ValueError, match=r"sources\.yaml") as error:
        read_sources(tmp_path / "sources.yaml")
    assert "\n" not in str(error.value) and all(word in str(error.value) for word in words)


def test_the_shipped_table_is_good():
    sources = read_sources(ROOT / "config" / "recordings" / "sources.yaml")
    assert len({source.file for source in sources}) == len(sources) > 10
    with pytest.raises(ValueError, match="offered by no source"):
        find_source(sources, "elsewhere.csv")
