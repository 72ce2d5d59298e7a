"""A comparison on a Dask cluster: the bytes of a local run, and one sentence where the cluster fails."""

import time

import pytest

from psflut import capture, cluster, compare
from psflut.errors import PsflutError
from psflut.shots import Simulated, between
from psflut.trial import Bench, method
from psflut.workers import local

distributed = pytest.importorskip("distributed", reason="dask is not installed: pip install psflut[lab]")
METHODS = ("wiener", "posterior:steps=50")


@pytest.fixture(scope="module")
def workers():
    """A scheduler and one worker of two threads, in this process."""
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=2, processes=False, dashboard_address=":0", silence_logs=50
    ) as running:
        yield running


@pytest.fixture
def bench(lab16mm, scene):
    shots = Simulated(lab16mm, capture.Setup(noise="0.005"), [("scene", scene)], between(lab16mm, 2), 3, 64, 0)
    return Bench(lab16mm, shots, {name: method(name) for name in METHODS})


def go(bench, folder, work):
    list(compare.run(bench, dict.fromkeys(bench.methods, 3), folder, work))
    return (folder / "results.csv").read_bytes()


def test_a_cluster_gives_the_bytes_of_a_local_run(bench, workers, tmp_path):
    there = go(bench, tmp_path / "there", lambda *words: cluster.cluster(*words, workers.scheduler_address))
    assert there == go(bench, tmp_path / "here", lambda *words: local(*words, 1))


def test_a_refusal_on_a_worker_comes_as_it_is(bench, workers, tmp_path):
    spoilt = Bench(bench.table, bench.shots, {"wiener": method("two_image+scene")})
    with pytest.raises(PsflutError, match=r"wiener, .* m: two_image compares"):
        go(spoilt, tmp_path, lambda *words: cluster.cluster(*words, workers.scheduler_address))


def test_a_cluster_that_does_not_answer_is_one_sentence_and_costs_nothing(bench, tmp_path, monkeypatch):
    monkeypatch.setattr(cluster, "PATIENCE", 0.5)
    go(bench, tmp_path, lambda bench, units: local(bench, units, 1))
    text = (tmp_path / "journal.jsonl").read_bytes()
    half = text[: text.index(b"\n", len(text) // 2) + 1]
    (tmp_path / "journal.jsonl").write_bytes(half)
    start = time.perf_counter()
    for address in ("tcp://127.0.0.1:9", "no address"):
        with pytest.raises(PsflutError, match="no Dask scheduler answers"):
            go(bench, tmp_path, lambda *words, there=address: cluster.cluster(*words, there))
    assert time.perf_counter() - start < 10
    assert (tmp_path / "journal.jsonl").read_bytes() == half


def test_a_cluster_without_workers_is_one_sentence(bench, tmp_path, monkeypatch):
    monkeypatch.setattr(cluster, "PATIENCE", 1.0)
    with (
        distributed.LocalCluster(n_workers=0, processes=False, dashboard_address=":0", silence_logs=50) as empty,
        pytest.raises(PsflutError, match="no worker"),
    ):
        go(bench, tmp_path, lambda *words: cluster.cluster(*words, empty.scheduler_address))
