"""A comparison: paired, seeded, the same whoever works and however often it was stopped; scores against analysis."""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest

from psflut import capture, compare, gallery, scores
from psflut.errors import PsflutError
from psflut.journal import Journal
from psflut.shots import Simulated, between
from psflut.trial import Bench, Record, Unit, method, trial
from psflut.workers import local

METHODS = ("wiener", "golden_section:redraws=2:iterations=5+scene")


def bench_of(table, scene, runs=3, count=2, seed=5, methods=METHODS):
    shots = Simulated(table, capture.Setup(noise="0.005"), [("scene", scene)], between(table, count), runs, 64, seed)
    return Bench(table, shots, {name: method(name) for name in methods}, seed=seed)


@pytest.fixture
def bench(lab16mm, scene):
    return bench_of(lab16mm, scene)


def go(bench, folder, work=lambda *words: local(*words, 1), runs=3):
    return [len(found) for found in compare.run(bench, dict.fromkeys(bench.methods, runs), folder, work)]


def test_a_capture_depends_on_its_own_numbers_alone(lab16mm, scene, bench):
    more = bench_of(lab16mm, scene, runs=7)
    first, again, other = bench.shots.take(1, 2), more.shots.take(1, 2), bench.shots.take(1, 1)
    np.testing.assert_array_equal(first.observation.image, again.observation.image)
    assert not np.array_equal(first.observation.image, other.observation.image)
    reseeded = bench_of(lab16mm, scene, seed=6).shots.take(1, 2)
    assert not np.array_equal(first.observation.image, reseeded.observation.image)


def test_captures_lie_off_the_grid_and_come_from_the_model(lab16mm, thesis, bench):
    for table in (lab16mm, thesis):
        for distance in between(table, 9):
            step = np.diff(table.axis)[np.searchsorted(table.axis, distance) - 1]
            assert np.abs(table.axis - distance).min() > 0.09 * step
    blank = replace(lab16mm, psf=np.roll(lab16mm.psf, 3, axis=0))
    other = replace(bench.shots, table=blank)  # a spoilt table changes nothing of a capture
    np.testing.assert_array_equal(other.take(0, 0).observation.image, bench.shots.take(0, 0).observation.image)


def test_every_method_sees_the_same_capture(bench):
    records = trial(bench, Unit(1, 2, tuple(bench.methods)))
    assert [record.method for record in records] == list(bench.methods)
    assert len({(r.truth, r.run, r.source, r.corner_y, r.corner_x) for r in records}) == 1
    alone = trial(bench, Unit(1, 2, METHODS[1:]))
    assert alone[0]._replace(seconds=0) == records[1]._replace(seconds=0)


def test_a_torn_journal_is_mended_and_nothing_is_done_twice(bench, tmp_path):
    go(bench, tmp_path / "whole")
    go(bench, tmp_path / "torn")
    path = tmp_path / "torn" / "journal.jsonl"
    text = path.read_bytes()
    path.write_bytes(text[: len(text) // 2])
    kept = text[: len(text) // 2].count(b"\n") - 1
    assert go(bench, tmp_path / "torn")[0] == kept
    cells = [
        tuple(json.loads(line)[k] for k in ("method", "position", "run")) for line in path.read_text().splitlines()[1:]
    ]
    assert len(cells) == len(set(cells)) == 2 * 2 * 3
    assert (tmp_path / "torn" / "results.csv").read_bytes() == (tmp_path / "whole" / "results.csv").read_bytes()
    assert go(bench, tmp_path / "torn") == [12]


def test_other_settings_do_not_mix(bench, lab16mm, scene, tmp_path):
    go(bench, tmp_path)
    before = (tmp_path / "journal.jsonl").read_bytes()
    for other in (bench_of(lab16mm, scene, seed=6), bench_of(lab16mm, scene[::-1]), replace(bench, level=0.5)):
        with pytest.raises(PsflutError, match=r"other settings.*another folder"):
            go(other, tmp_path)
    assert (tmp_path / "journal.jsonl").read_bytes() == before


def test_a_file_in_the_way_is_refused(bench, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(PsflutError, match="another"):
        go(bench, tmp_path / "file")
    (tmp_path / "journal.jsonl").write_text("what is this\n")
    with pytest.raises(PsflutError, match="no journal"):
        go(bench, tmp_path)


def test_a_refusal_in_a_process_comes_as_one_sentence(bench, tmp_path):
    spoilt = replace(bench, methods={name: method("two_image+scene") for name in METHODS[:1]})
    with pytest.raises(PsflutError, match=r"wiener, scene at .* m: two_image compares"):
        go(spoilt, tmp_path, lambda *words: local(*words, 2))


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs kill -9")
def test_a_killed_comparison_goes_on_where_it_stopped(run, tmp_path, monkeypatch):
    """kill -9 in the middle: the finished cells stay, and one process ends with the results of an unbroken run."""
    words = ["compare", "--table", "lab16mm", "--images", "camera", "--method", ",".join(METHODS), "--distances", "3"]
    words += ["--runs", "4", "--size", "64", "--workers"]
    begun = [*words, "2", "-o", str(tmp_path / "killed")]
    code = f"import sys; sys.argv[1:] = {begun!r}; from psflut.cli import main; main()"
    journal = tmp_path / "killed" / "journal.jsonl"
    killed = subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 60
    while not (journal.exists() and journal.read_bytes().count(b"\n") > 5) and time.monotonic() < deadline:
        time.sleep(0.02)
    os.kill(killed.pid, signal.SIGKILL)
    killed.wait()
    before = journal.read_bytes()
    assert 5 < before.count(b"\n") < 25
    monkeypatch.setattr(gallery, "draw", lambda *_: None)
    for folder in ("killed", "whole"):
        assert run(*words, 1, "-o", tmp_path / folder) == 0
    assert journal.read_bytes().startswith(before[: before.rindex(b"\n") + 1])
    assert journal.read_bytes().count(b"\n") == 25
    for name in ("results.csv", "results.zarr/estimate/c/0/0/0"):  # begun by two processes, or all by one
        assert (tmp_path / "killed" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()


def test_a_journal_keeps_only_whole_lines(tmp_path):
    record = Record("wiener", 0, 0, 1.0, "a", 0, 0, 1.0, 0.9, 1.1, "ok", 0.1)
    path = tmp_path / "journal.jsonl"
    with Journal(path, {"seed": 1}) as journal:
        journal.append([record])
    path.write_bytes(path.read_bytes()[:-3])
    with Journal(path, {"seed": 2}) as journal:  # without a record its settings bind nobody
        assert journal.records == []
        journal.append([record])
    with Journal(path, {"seed": 2}) as journal:
        assert journal.records == [record]


def records_of(method, errors, sd, truth=2.0):
    """Records of the stated errors (positions, runs), metres, with 95 % intervals of normal errors."""

    def record(position, run, error):
        z = truth + position + error
        near, far = z - 1.96 * sd, z + 1.96 * sd
        return Record(method, position, run, truth + position, "a", 0, 0, z, near, far, "ok", 1e-3)

    return [record(k, r, error) for k, row in enumerate(errors) for r, error in enumerate(row)]


def test_scores_of_normal_errors_are_those_of_theory(rng):
    bias, sd = 0.03, 0.02
    records = records_of("normal", bias + sd * rng.standard_normal((5, 2000)), sd)
    (score,) = scores.scores(records)
    assert score.bias == pytest.approx(bias, abs=5 * sd / 100)
    assert score.scatter == pytest.approx(sd, rel=0.05)
    assert score.rmse == pytest.approx(np.hypot(bias, sd), rel=0.05)
    assert score.width == pytest.approx(2 * 1.96 * sd)
    assert score.coverage == pytest.approx(0.677, abs=0.02)  # of |1.5 + normal| < 1.96
    centred = scores.scores(records_of("normal", sd * rng.standard_normal((5, 2000)), sd))[0]
    assert centred.coverage == pytest.approx(0.95, abs=0.01)
    assert centred.median_error == pytest.approx(0.6745 * sd, rel=0.05)


def test_the_ratio_counts_only_captures_that_both_saw_and_its_interval_covers(rng):
    half = rng.standard_normal((200, 40))
    inside = 0
    for row in half:
        other = rng.standard_normal((1, 40))
        base = records_of("golden_section", other, 1.0)
        _, low, high = scores.paired_ratio(records_of("m", 0.5 * row[None], 1.0), base)
        inside += low <= 0.5 <= high
    assert inside >= 180  # 190 are expected, sd 3
    few = scores.paired_ratio(records_of("m", [[0.5, 0.5]], 1.0), records_of("golden_section", [[1.0, 1.0, 99.0]], 1.0))
    assert few == (0.5, 0.5, 0.5)


def test_intervals_that_know_give_a_rising_risk_and_others_do_not(rng):
    sd = np.geomspace(0.01, 0.1, 4000)
    errors = sd * rng.standard_normal(4000)
    knowing = [records_of("m", [[e]], s)[0] for e, s in zip(errors, sd, strict=True)]
    kept, risk = scores.risk_coverage(knowing)
    expected = np.sqrt(2 / np.pi) * np.cumsum(sd) / np.arange(1, 4001) / 2.0
    np.testing.assert_allclose(risk[1000::500], expected[1000::500], rtol=0.1)
    assert kept[-1] == 1
    blind = [records_of("m", [[e]], s)[0] for e, s in zip(errors, rng.permutation(sd), strict=True)]
    assert scores.risk_coverage(blind)[1][1000] == pytest.approx(risk[-1], rel=0.15)
