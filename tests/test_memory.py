"""The memory of a step is estimated before it is computed, and a scene that needs more than there is, is refused."""

import jax.numpy as jnp
import pytest

from jaxves.geometry import shapes
from jaxves.geometry.domain import Cell, Free
from jaxves.inputs.checking import SceneError
from jaxves.operators.memory import bytes_of_step
from jaxves.operators.pairs import Pairwise
from jaxves.operators.sums import MatrixFree, coupling_in_cell
from jaxves.physics.scene import make_scene
from jaxves.runs.problem import memory_of_machine, nodes_in_memory, require_memory


def needed(M, coupling, N=64, domain=None):
    return bytes_of_step(M, N, coupling, Free() if domain is None else domain, electric=True)


def test_sums_grow_like_the_number_of_vesicles_and_matrices_like_its_square():
    cell = Cell.of([[1.0, 0.0], [0.0, 1.0]])
    for coupling, domain in ((MatrixFree(), Free()), (coupling_in_cell(), cell)):
        assert 3.8 < needed(1024, coupling, domain=domain) / needed(256, coupling, domain=domain) < 4.2
        less = needed(64, coupling, domain=domain)
        more = bytes_of_step(64, 64, coupling, domain, electric=True, contrast=True)
        assert 1.2 < more / less < 2.0
    pairs = Pairwise(direct=True)
    assert 14 < needed(256, pairs) / needed(64, pairs) < 16.1
    assert needed(1, None) < needed(2, pairs)


def test_nodes_are_added_only_as_far_as_memory_allows():
    scene = make_scene(list(jnp.stack([shapes.circle(16)] * 4) + 3.0 * jnp.arange(4)[:, None, None]))
    two = float(bytes_of_step(4, 128, MatrixFree(), Free(), electric=False))
    assert nodes_in_memory(scene, MatrixFree(), two) == 128
    assert nodes_in_memory(scene, MatrixFree(), two - 1) == 96
    assert nodes_in_memory(scene, MatrixFree(), 1.0) == 0


def test_a_scene_without_room_is_refused_before_it_starts():
    scene = make_scene(list(jnp.stack([shapes.circle(16)] * 4) + 3.0 * jnp.arange(4)[:, None, None]))
    require_memory(scene, MatrixFree(), memory_of_machine())
    with pytest.raises(SceneError, match=r"numerics.nodes = 16 for 4 vesicles needs about .* GiB of memory, expected"):
        require_memory(scene, MatrixFree(), 1e5)
