"""The committed benchmark data: complete, the same in both formats, and what a run gives to the digits stated."""

import h5py
import numpy as np
import pytest

from experiments import benchmarks


@pytest.mark.parametrize("name", benchmarks.BENCHMARKS)
def test_a_benchmark_is_complete_and_the_same_in_both_formats(name):
    columns, stated = benchmarks.read(name)
    benchmark = benchmarks.BENCHMARKS[name]
    assert set(columns) == {"t", *stated}
    np.testing.assert_allclose(
        columns["t"], benchmark.t_end * np.arange(1, benchmark.saves + 1) / benchmark.saves, atol=1e-12
    )
    assert benchmark.about in (benchmarks.FOLDER / f"{name}.csv").read_text()
    with h5py.File(benchmarks.FOLDER / "benchmarks.h5") as file:
        for key, values in columns.items():
            assert np.all(np.isfinite(values))
            np.testing.assert_allclose(file[name][key][:], values, rtol=1e-11, atol=1e-14)


def test_a_run_repeats_the_digits_that_are_stated():
    """Relaxation, its first tenth, with the nodes, tolerance and method that the data were checked with."""
    columns, stated = benchmarks.read("relaxation")
    found, _ = benchmarks.columns("relaxation", benchmarks.BENCHMARKS["relaxation"].check, fifth=False, share=0.1)
    for key, digits in stated.items():
        here = columns[key][: len(found["t"])]
        scale = np.max(np.abs(columns[key]))
        assert digits >= 5
        assert np.max(np.abs(found[key] - here)) < 10.0**-digits * scale, key


def test_differences_and_digits_are_relative_to_the_largest_value():
    best = {"t": np.arange(2.0), "a": np.array([2.0, -4.0])}
    found = benchmarks.differences({"t": np.arange(2.0), "a": np.array([2.0, -4.004])}, best)
    assert found == {"a": pytest.approx(1e-3)}
    assert benchmarks.digits(2e-9) == 8
