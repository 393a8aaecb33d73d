"""The space that the vesicles of a scene are in, and the default coupling between them."""

from ..base.arguments import refusal
from ..geometry.domain import AbstractDomain, Cell, Free
from ..operators.interactions import AbstractCoupling
from ..operators.sums import MatrixFree, coupling_for, coupling_in_cell
from ..physics.scene import Scene


def domain_of(scene: Scene) -> AbstractDomain:
    """Returns the plane or the periodic cell of a scene. A shear flow carries the lattice of a cell along."""
    if scene.cell is None:
        return Free()
    if scene.flow is None:
        return scene.cell
    return Cell(scene.cell.lattice, scene.flow.capillary_number, scene.cell.aspect)


def coupling_of(scene: Scene, coupling: AbstractCoupling | None) -> AbstractCoupling | None:
    """Returns `coupling`, or the default if it is None. A single membrane in the plane has none.

    Raises:
        ValueError: the scene has a periodic cell, and `coupling` does not sum over its images.
    """
    M, N, _ = scene.x.shape
    if scene.cell is None:
        return coupling_for(M, N) if M == 1 or coupling is None else coupling
    if coupling is None:
        return coupling_in_cell()
    if not (isinstance(coupling, MatrixFree) and coupling.accuracy is not None):
        raise refusal("coupling", coupling, "MatrixFree with an accuracy: in a cell, sums run over all images")
    return coupling


def may_keep_symmetry(scene: Scene) -> bool:
    """Returns whether a symmetric vesicle stays symmetric: in the plane, a uniform field, and a linear flow."""
    if scene.field is not None and not scene.field.is_uniform():
        return False
    return scene.cell is None and (scene.flow is None or scene.flow.is_linear())
