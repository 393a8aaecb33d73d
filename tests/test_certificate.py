"""The certificate: links are errors of what is known, and the weakest is named."""

import numpy as np

from jaxves.observables.certificate import certificate, weakest


def diagnostics(**changed):
    """Three saved times of a vesicle for which everything holds."""
    ones, zeros = np.ones((3, 1)), np.zeros((3, 1))
    found = {"area": ones, "length": ones, "time_error": np.array([0.0, 1e-6, 3e-6])}
    found |= {name: zeros for name in ("spectral_tail", "tension_tail", "force_residual", "torque_residual")}
    found |= {"bending_energy": zeros}
    found |= {"dissipation": np.array([2.0, 1.0, 0.0]), "power_balance": np.zeros(3), "residual": np.zeros(3)}
    return found | changed


def test_the_weakest_link_is_the_largest_error():
    links = certificate(diagnostics())
    assert weakest(links) == "time" and abs(links["time"].digits - 5.523) < 1e-3
    assert links["space"].digits == 16 and "charge" not in links
    links = certificate(diagnostics(area=np.array([[1.0], [1.0], [1.0 - 1e-3]])))
    assert weakest(links) == "area" and abs(links["area"].digits - 3) < 1e-9


def test_the_balance_of_powers_is_measured_by_the_greatest_of_them():
    links = certificate(diagnostics(power_balance=np.array([0.0, -1e-2, 0.0]), power_flow=np.array([4.0, 0.0, 0.0])))
    assert abs(links["energy"].value - 2.5e-3) < 1e-12 and weakest(links) == "energy"


def test_at_rest_the_balance_is_measured_by_the_bending_energy():
    """Two nearly equal powers of a vesicle that does not move have no common digit, and do not need one."""
    energy, rest = np.full((3, 1), 4.0), {"dissipation": np.full(3, 1e-5), "power_flow": np.full(3, 7e-6)}
    links = certificate(diagnostics(bending_energy=energy, power_balance=np.full(3, 3e-6), **rest))
    assert links["energy"].digits > 2
    links = certificate(diagnostics(bending_energy=energy, power_balance=np.full(3, 1e-3), **rest))
    assert links["energy"].digits < 1


def test_what_is_not_a_number_is_the_weakest_link():
    assert weakest(certificate(diagnostics(residual=np.array([0.0, np.nan, 0.0])))) == "solves"
