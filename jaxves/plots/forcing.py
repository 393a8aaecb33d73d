"""The imposed field and flow as a small sketch beside the shapes."""

import tomllib
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

from ..physics.scene import Scene
from .style import INK, time_label

_GRADIENTS = {"shear": ((0, 1), (0, 0)), "extension": ((1, 0), (0, -1))}
_STEADY = 1e-9  # relative change of a flow that counts as none
PLACES = 0.6 * np.stack(np.meshgrid([-1, 0, 1], [-1, 0, 1]), axis=-1).reshape(-1, 2)


class Forcing(NamedTuple):
    """The direction of the field, and the velocity of the flow at `PLACES` up to a factor; None if absent.

    `when` is what the label of a flow that changes in time says of it.
    """

    direction: Float[np.ndarray, "2"] | None
    velocity: Float[np.ndarray, "9 2"] | None
    when: str = ""

    def is_absent(self) -> bool:
        """Returns whether there is neither a field nor a flow."""
        return self.direction is None and self.velocity is None


def forcing_of(record: Any) -> Forcing:
    """Returns the field and the flow of a result, from its scene or from the text of its scene file."""
    scene = getattr(record, "scene", None)
    return (
        _of_scene(scene, np.asarray(record.t)) if isinstance(scene, Scene) else _of_tables(tomllib.loads(scene or ""))
    )


def _of_scene(scene: Scene, t: np.ndarray) -> Forcing:
    uniform = scene.field is not None and scene.field.is_uniform()
    direction = None if not uniform else np.asarray(scene.field.unit_direction())
    if scene.flow is None:
        return Forcing(direction, None)
    # A flow that starts from rest or alternates is drawn when it is strongest.
    times = np.linspace(0.0, np.nanmax(t), 9)
    places = jnp.asarray(PLACES)[None]
    velocities = np.stack([np.asarray(scene.flow.velocity(places, jnp.asarray(at))[0]) for at in times])
    strongest = np.argmax(np.abs(velocities).max(axis=(1, 2)))
    changes = np.ptp(velocities, axis=0).max() > _STEADY * np.abs(velocities).max()
    return Forcing(direction, velocities[strongest], f"\nat {time_label(times[strongest])}" if changes else "")


def _of_tables(tables: dict) -> Forcing:
    direction, velocity, when = None, None, ""
    if "direction" in tables.get("field", {}):  # a field of Python that is not uniform has none
        direction = np.array(tables["field"]["direction"], dtype=float)
    if "flow" in tables:
        flow = tables["flow"]
        sign = np.sign(flow.get("capillary_number", 1.0))
        if flow["kind"] == "poiseuille":
            velocity = sign * np.stack([1 - PLACES[:, 1] ** 2, np.zeros(len(PLACES))], axis=-1)
        else:
            gradient = np.array(flow["gradient"] if flow["kind"] == "linear" else _GRADIENTS[flow["kind"]], dtype=float)
            velocity = sign * PLACES @ gradient.T
        if flow.get("time", {}).get("kind", "constant") != "constant":
            when = r"$(t)$"  # a factor of time, which the sketch does not have
    return Forcing(direction, velocity, when)


def draw_forcing(ax: Axes, forcing: Forcing) -> None:
    """Draws the field as one arrow and, below it, the flow as several."""
    both = forcing.direction is not None and forcing.velocity is not None
    ax.set(xlim=(-1, 1), ylim=(-2, 2) if both else (-1, 1), aspect="equal")
    ax.set_axis_off()
    text = dict(textcoords="offset points", ha="center", va="center")
    if forcing.direction is not None:
        half = 0.6 * forcing.direction / np.linalg.norm(forcing.direction)
        center = np.array([0.0, 1.0 if both else 0.0])
        arrow = dict(arrowstyle="-|>", color=INK, linewidth=1.0, shrinkA=0, shrinkB=0)
        ax.annotate("", center + half, center - half, arrowprops=arrow)
        ax.annotate(r"$\mathbf{E}_\infty$", center, 18 * np.array([half[1], -half[0]]), **text)
    if forcing.velocity is not None:
        arrows = 0.6 * forcing.velocity / (np.abs(forcing.velocity).max() or 1.0)
        center = -1.0 if both else 0.0
        ax.quiver(
            *PLACES.T + np.array([[0.0], [center]]), *arrows.T, color=INK, angles="xy", scale_units="xy",
            scale=1.2, pivot="mid", units="xy", width=0.08,
        )  # fmt: skip
        label = r"$\mathbf{v}_\infty$" + forcing.when
        ax.annotate(label, (0.0, center - 0.95), (0, 1), **text | {"va": "top"})
