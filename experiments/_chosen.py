"""Scenes at the ends of the parameters, alone and combined, as tables by name."""

from ._all_models import SAVES, touching


def _scene(t_end, *, vesicle=(), nodes=64, **tables) -> dict:
    """Returns an upright ellipse with Δ = 0.9, changed by `vesicle`, and other tables."""
    one = {"reduced_area": 0.9, "angle": 90.0} | dict(vesicle)
    return {"t_end": t_end, "saves": SAVES, "vesicle": [one], "numerics": {"nodes": nodes}} | tables


def _field(beta=3.2, ratio=0.1, **numbers) -> dict:
    return {"beta": beta, "conductivity_ratio": ratio} | numbers


def _ac(frequency, averaged=True, **numbers) -> dict:
    return {"kind": "ac", "frequency": frequency, "averaged": averaged} | numbers


def _shear(rate) -> dict:
    return {"kind": "shear", "capillary_number": rate}


def _pair(gap, t_end, angle=90.0, offset=90.0, reduced_area=0.9, **tables) -> dict:
    vesicle = {"reduced_area": reduced_area, "angle": angle}
    pair = {"separation": touching(vesicle, offset) + gap, "offset_angle": offset}
    return _scene(t_end, vesicle=vesicle, pair=pair, **tables)


def _cell(side, t_end, **tables) -> dict:
    return _scene(t_end, cell={"lattice": [[side, 0.0], [0.0, 1.2 * side]]}, **tables)


_FLUID = {f"ν = {ratio:g}": {"viscosity_ratio": ratio} for ratio in (1e-6, 1e-3, 10.0, 1e4, 1e8)}

CHOSEN = {
    **{f"{name} in a field": _scene(0.3, fluid=fluid, field=_field()) for name, fluid in _FLUID.items()},
    **{f"{name} in a flow": _scene(0.3, fluid=fluid, flow=_shear(10.0)) for name, fluid in _FLUID.items()},
    "ν = 1e8, strong flow": _scene(0.01, fluid=_FLUID["ν = 1e+08"], flow=_shear(1e3)),
    "ν = 1e-6, Δ = 0.5, field and flow": _scene(
        0.1, vesicle={"reduced_area": 0.5}, fluid=_FLUID["ν = 1e-06"], field=_field(), flow=_shear(10.0)
    ),
    "ν = 1e4, relaxing charge": _scene(0.3, fluid=_FLUID["ν = 10000"], field=_field(charge_relaxation=1e-3)),
    **{f"δ = {d:g}": _scene(0.3, field=_field(charge_relaxation=d)) for d in (1e-5, 1e-2, 1.0)},
    "δ = 1e-5, resolved AC": _scene(0.2, field=_field(charge_relaxation=1e-5, time=_ac(50.0, False))),
    "δ = 1e-5, averaged AC": _scene(0.3, field=_field(charge_relaxation=1e-5, time=_ac(1e4))),
    "δ = 1, χ = 1e-7": _scene(1e-2, field=_field(1e-6, chi=1e-7, charge_relaxation=1.0)),
    "δ = 1, G = 1e3": _scene(0.3, field=_field(charge_relaxation=1.0, membrane_conductance=1e3)),
    "δ = 0.01, insulating inside": _scene(0.3, field=_field(ratio=0.0, charge_relaxation=0.01)),
    **{f"averaged AC, f = {f:g}": _scene(0.3, field=_field(time=_ac(f))) for f in (1.0, 1e3, 1e6)},
    "averaged AC with conductance": _scene(0.3, field=_field(membrane_conductance=10.0, time=_ac(100.0))),
    "averaged AC, infinite Λ": _scene(0.3, field=_field(ratio=float("inf"), time=_ac(100.0))),
    "averaged AC, Λ = 0": _scene(0.3, field=_field(ratio=0.0, time=_ac(100.0))),
    "averaged AC, offset, ν = 10, flow": _scene(
        0.3, fluid=_FLUID["ν = 10"], field=_field(time=_ac(100.0, offset=1.0)), flow=_shear(10.0)
    ),
    "resolved AC, f = 200": _scene(0.1, field=_field(time=_ac(200.0, False))),
    "χ = 1e-7, β/χ = 100": _scene(0.3, field=_field(1e-5, chi=1e-7)),
    "χ = 1e-7, β/χ = 1e5, Λ = 10": _scene(1e-4, field=_field(1e-2, 10.0, chi=1e-7), nodes="auto"),
    "χ = 10, β/χ = 1e5, Λ = 10": _scene(1e-4, field=_field(1e6, 10.0, chi=10.0), nodes="auto"),
    "β/χ = 1e5, Λ = 0.1, 64 nodes": _scene(1e-4, field=_field(1.0, chi=1e-5)),
    "β/χ = 3e3, Λ = 0.1": _scene(1e-3, field=_field(0.03, chi=1e-5), nodes="auto"),
    "ε_i/ε_e = 100": _scene(0.2, field=_field(permittivity_ratio=100.0)),
    "ε_i/ε_e = 0.01, Λ = 10": _scene(0.2, field=_field(ratio=10.0, permittivity_ratio=0.01)),
    "thin ellipse": _scene(0.05, vesicle={"reduced_area": 0.2}, field=_field(), nodes="auto"),
    "thin ellipse in a flow": _scene(0.02, vesicle={"reduced_area": 0.2}, flow=_shear(100.0), nodes="auto"),
    "circle in a field": _scene(0.3, vesicle={"reduced_area": 1.0}, field=_field()),
    "circle in a flow": _scene(0.3, vesicle={"reduced_area": 1.0}, flow=_shear(10.0), fluid=_FLUID["ν = 10"]),
    "neck": _scene(0.24, vesicle={"reduced_area": 0.5}, field=_field(12.8), nodes=128),
    "pulse of a stiff vesicle": _scene(
        0.3, vesicle={"bending": 100.0}, field=_field(time={"kind": "pulse", "start": 0.05, "duration": 0.1})
    ),
    "large and relaxed": _scene(0.3, vesicle={"length": 3.0, "relaxed": True}, field=_field()),
    "Poiseuille": _scene(0.1, flow={"kind": "poiseuille", "capillary_number": 100.0, "half_width": 2.0}),
    "extension, Ca = 1000": _scene(3e-3, flow={"kind": "extension", "capillary_number": -1000.0}, nodes="auto"),
    "pair, gap 0.01, ν = 10": _pair(0.01, 0.1, fluid=_FLUID["ν = 10"], flow=_shear(10.0)),
    "pair, gap 0.01, ν = 1e-3, field": _pair(0.01, 0.1, fluid=_FLUID["ν = 0.001"], field=_field()),
    "pair, gap 0.05, δ = 0.01": _pair(0.05, 0.1, field=_field(charge_relaxation=0.01)),
    "pair, gap 0.05, averaged AC": _pair(0.05, 0.1, field=_field(time=_ac(100.0))),
    "pair, gap 0.1, Δ = 0.4": _pair(0.1, 0.05, reduced_area=0.4, offset=0.0, field=_field(), nodes="auto"),
    "pair, gap 0.1, ν = 1e8, δ = 1e-5": _pair(
        0.1, 0.1, fluid=_FLUID["ν = 1e+08"], field=_field(charge_relaxation=1e-5)
    ),
    "cell, Ca = 1000": _cell(4.0, 5e-3, flow=_shear(1e3)),
    "cell, dense": _cell(2.4, 0.1, flow=_shear(10.0), field=_field()),
    "cell, resolved AC, G": _cell(3.5, 0.1, field=_field(membrane_conductance=1.0, time=_ac(50.0, False))),
    "cell, infinite Λ": _cell(3.5, 0.1, field=_field(ratio=float("inf"))),
    "cell, β/χ = 1e4, Λ = 10": _cell(3.5, 1e-3, field=_field(0.1, 10.0, chi=1e-5)),
}
