"""The measurements at toy size on the CPU: what they write, not how fast. Report and comparison of small results."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from perf import (
    __main__,
    compare,
    compile,
    cpu,
    divergence,
    fusion,
    inference,
    layout,
    machine,
    measure,
    mipmap,
    peak,
    peers,
    pictures,
    precision,
    report,
    samples,
    texture_reading,
    training,
)
from perf.goals import GOALS, TESTED
from perf.results import Figure, Result, load_all
from warp_neural.cli import run
from warp_neural.errors import InputError
from warp_neural.imaging.image import load_image

MEASUREMENTS = {
    inference: (inference.InferenceConfig, ["--samples", "128"], ("float32, float32 sums", "2x32", "GFLOP/s")),
    divergence: (measure.Config, [], ("8", "float16 2x32, sorted", "GFLOP/s")),
    fusion: (measure.Config, [], ("separate bias", "2x32", "GFLOP/s")),
    layout: (measure.Config, [], ("row major", "2x32", "GFLOP/s")),
    precision: (precision.PrecisionConfig, ["--steps", "20"], ("int8, float32 sums", "PSNR", "dB")),
    training: (training.TrainingConfig, ["--batch", "64"], ("2x32, 64", "update", "ms")),
    compile: (measure.Config, [], ("training step, 2x32", "cold", "s")),
    mipmap: (measure.Config, [], ("gradient", "time", "ms")),
    cpu: (cpu.CpuConfig, ["--samples", "1024"], ("Warp Neural", "training step", "ms")),
    samples: (measure.Config, [], ("mipmap: linear error / box", "figure", "")),
    texture_reading: (measure.Config, [], ("for engines", "frame", "ms")),
}


@pytest.fixture
def alone(monkeypatch):
    """Without peers, other processes and whole samples: those have tests of their own, or take minutes."""
    for module in (peak, peers):
        monkeypatch.setattr(module, "find_spec", lambda name: None)
    monkeypatch.setattr(
        compile, "in_new_process", lambda case, device, cache: compile.first_call(case.what, 2, 32, "cpu")
    )
    ways = ("adam", "box", "toksvig", "sgd")
    metrics = {f"{kind}_{way}": 1.0 + i for kind in ("linear", "display") for i, way in enumerate(ways)}
    monkeypatch.setattr(samples, "run_sample", lambda name, device: (metrics, 1.5))


@pytest.mark.parametrize("module", MEASUREMENTS, ids=lambda module: module.__name__)
def test_measurement(alone, module, tmp_path, capfd):
    config, options, (row, column, unit) = MEASUREMENTS[module]
    common = ["--device", "cpu", "--quick", "--rounds", "2", "--json", "--out", str(tmp_path)]
    metrics = run(module.main, config, common + options)
    captured = capfd.readouterr()
    assert json.loads(captured.out) == metrics
    name = module.__name__.removeprefix("perf.")
    result = load_all(tmp_path)[name]
    figure = result.find(row, column)
    assert (figure.unit, metrics[f"{row} / {column}"]) == (unit, figure.value)
    assert figure.low <= figure.value <= figure.high
    zero = "float16 under float32", "pixels off by 1/255"  # rows, columns that may be
    assert all(f.value > 0 or {f.row, f.column} & set(zero) for f in result.figures)
    assert result.machine["CPU"] == machine.cpu_name() and "Warp" in result.machine
    assert result.table() in captured.err  # with --json, all but the metrics goes there
    assert load_image(tmp_path / f"{name}.png").std() > 0.01


def test_all_measurements_are_run(monkeypatch):
    names = {module.__name__.removeprefix("perf.") for module in MEASUREMENTS}
    names |= {"profile", "texture_torch"}
    assert names == set(report.ORDER) and names | {"texture_codecs", "texture_storage"} == set(__main__.NAMES)
    monkeypatch.setattr(__main__, "find_spec", lambda name: None)
    config = __main__.AllConfig(quick=True)
    assert not {"samples", "profile", "texture_torch", "texture_codecs"} & set(__main__.chosen(config, cuda=True))
    monkeypatch.setattr(__main__, "find_spec", lambda name: name)
    assert "profile" not in __main__.chosen(config, cuda=False)
    config = __main__.AllConfig(device="cuda", material=Path("stones"))
    assert set(__main__.NAMES) - set(__main__.chosen(config, cuda=True)) == {"cpu", "samples"}


def test_run_stops_where_one_fails(monkeypatch, tmp_path, capsys):
    class Done:
        returncode, stderr = 1, "the reason"

    monkeypatch.setattr(__main__, "measure", lambda name, options: Done)
    with pytest.raises(SystemExit):
        __main__.main(__main__.AllConfig(device="cpu", out=tmp_path, quick=True))
    assert "perf.layout failed:\nthe reason" in capsys.readouterr().err


def test_a_wrong_result_is_not_timed():
    with pytest.raises(RuntimeError, match=r"product: relative error 1.0e\+00 is above 1.0e-03; nothing was timed"):
        measure.check("product", 2 * np.ones(4), np.ones(4), 1e-3)


@pytest.mark.parametrize("kind", peak.PRODUCTS, ids=str)
def test_operands_of_the_peak(kind):
    """The sum of all products, from the registers by the PTX tables of fragments."""
    product = peak.PRODUCTS[kind]
    words, expected = peak.operands(product, seed=1)
    bits, per_word = 32 // product.per_word, product.per_word
    codes = (words[:, None] >> (np.arange(per_word) * bits).astype("u4")) & (2**bits - 1)
    values = np.where(codes == product.one, 1, -1).reshape(16, 8, 4, per_word)
    assert set(np.unique(codes)) == {product.one, product.negative}
    total, depth = 0, product.depth
    for m in range(2):
        a = np.zeros((16, depth))
        for r, g, t, e in np.ndindex(4, 8, 4, per_word):
            a[g + 8 * (r % 2), depth // 2 * (r // 2) + per_word * t + e] = values[4 * m + r, g, t, e]
        for j in range(4):
            b = np.zeros((depth, 8))
            for r, g, t, e in np.ndindex(2, 8, 4, per_word):
                b[depth // 2 * r + per_word * t + e, g] = values[8 + 2 * j + r, g, t, e]
            total += (a @ b).sum()
    assert expected == total * (1 if product.flip else peak.STEPS)


def small(folder, step: float, spread: float = 0.01, **more: float):
    """Results of one machine: one core's training step in ms, PyTorch's, a recorded one; and more rows."""
    result = Result("cpu", {"device": "Some CPU", "Warp": "1.19.0"}, {"rounds": "12"})
    for row, value in {"Warp Neural": step, "PyTorch eager": 4.0, **more}.items():
        result.figures.append(Figure(row, "training step", value, value * (1 - spread), value * (1 + spread), "ms"))
    result.figures.append(Figure("another", "training step", 9.0 * step, 9.0 * step, 9.0 * step, "ms", recorded=True))
    result.save(folder)
    result.measurement, result.figures = "inference", [Figure("block 64", "2x32", 7, 6, 8, "GFLOP/s")]
    result.save(folder)


def test_report(tmp_path):
    small(tmp_path / "results" / "some-cpu", 2.0)
    small(tmp_path / "results" / "slow-cpu", 5.0)
    metrics = report.main(report.Config(results=tmp_path / "results"))
    goals = sum(not goal.cuda for goal in GOALS)
    counted = [metrics[f"some-cpu_{kind}"] for kind in ("met", "missed", "not_measured")]
    assert counted == [1, 0, goals - 1] and metrics["slow-cpu_missed"] == 1
    page = (tmp_path / "RESULTS.md").read_text()
    assert "| one core, a step of 16,384 | 0.5 | at most 1 of PyTorch eager | **met** (-50%) |" in page
    assert "| 1.25 | at most 1 of PyTorch eager | **missed** (+25%) |" in page
    assert "not measured here" in page and "| another *(recorded)* | 18 |" in page
    assert "**Block**, 2x32: 64 threads" in page and "](results/some-cpu/cpu.png)" in page


def test_compare(tmp_path, capsys):
    small(tmp_path / "old", 2.0, still=1.0, gone=1.0)
    small(tmp_path / "new", 1.5, still=1.015)
    changes = compare.main(compare.Config(tmp_path / "old", tmp_path / "new", json=True))
    assert changes == {"cpu / Warp Neural / training step": pytest.approx(-0.25)}
    assert "1 of 4 moved; only in old: 1, only in new: 0" in capsys.readouterr().out


def test_damaged_results(tmp_path):
    with pytest.raises(InputError, match="no such folder of results"):
        compare.main(compare.Config(tmp_path / "a", tmp_path / "b"))
    with pytest.raises(InputError, match="no results"):
        report.main(report.Config(results=tmp_path))
    (tmp_path / "machine").mkdir()
    (tmp_path / "machine" / "cpu.json").write_text('{"figures": [1]}')
    with pytest.raises(InputError, match=r"cpu\.json: not a result of perf"):
        report.main(report.Config(results=tmp_path))


def test_goals_that_tests_hold_name_tests():
    folder = Path(__file__).parent
    for names in (names for goals in TESTED.values() for names in goals.values()):
        assert all((folder / f"{name}.py").exists() for name in names.split(", ")), names


def test_goals_by_unit_and_multiple():
    result = Result("layout", {}, {}, [Figure("a", "x", 10, 9, 11, "ms"), Figure("b", "x", 4, 4, 4, "ms")])
    goal = replace(GOALS[0], measurement="layout", row="a", column="x", limit=8, most=False, unit="ms")
    assert goal.judge({"layout": result}) == ("10 ms", "at least 8 ms", "**met** (+25%)")
    relative = replace(goal, limit=2, most=True, of=("b", "x"))
    assert relative.judge({"layout": result}) == ("2.5", "at most 2 of b", "**missed** (+25%)")
    assert relative.judge({})[0] == "not measured here"


def test_picture_of_steps():
    """A bar for each row, and other libraries' steps as points in the rows that they belong to."""
    result = Result("training", {"device": "device"}, {})
    for row, value in (("2x32, 64", 1.0), ("3x64, 64", 2.0), ("3x64, 64, PyTorch eager", 5.0)):
        result.figures.append(Figure(row, "step", value, value, value, "ms"))
    result.figures.append(Figure("2x32, 64, tiny-cuda-nn", "step", 3.0, 3.0, 3.0, "ms", recorded=True))
    (ax,) = pictures.steps(result).axes
    assert [bar.get_width() for bar in ax.patches] == [1.0, 2.0]
    points = {drawn.get_label(): drawn.get_xydata().tolist() for drawn in ax.lines}
    assert points == {"PyTorch eager": [[5.0, 1.0]], "tiny-cuda-nn (recorded)": [[3.0, 0.0]]}
