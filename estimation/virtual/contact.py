"""Virtual recordings of any contact that the contact model solves."""

import numpy as np
from jaxtyping import Bool, Float
from scipy.interpolate import interpn

from contactmodel.elasticity.bodies import stiffness_ratio
from contactmodel.grid import Grid
from contactmodel.solution import ContactSolution
from estimation.fields.stick import MIN_STICK_MARKERS
from estimation.frames.recording import MarkerLayout, Recording
from estimation.virtual.recording import Camera, Truth, record, see_all


def simulate_recording(
    path: ContactSolution,
    sensor: MarkerLayout,
    camera: Camera | None = None,
    *,
    depth: float = 0.0,
    unloaded: int = 10,
    moved: Float[np.ndarray, "frames n 3"] | None = None,
) -> tuple[Recording, Truth]:
    """Simulate a sensor's recording of a contact along a path.

    The markers move with the elastomer, on its surface or below. The effect of a domed pad is part
    of the shape with which the path was solved (`Domed`). A marker is in contact, and sticks, if
    the cell above it in the undeformed state does. Its displacement is that of its unloaded
    position, as in linear elasticity, whereas a real rotation starts at the position after
    pressing. On thin pads, which spread by 1 to 2 % when pressed by a tenth of their thickness or
    more, the markers of a recording therefore rotate by that much too little
    (`papers.softness.contacts` corrects this).

    Args:
        path: contacts of `contactmodel.solve_path`, one for each frame.
        sensor: the unloaded markers in three dimensions, in the frame of the path's grid.
        camera: noise, clock and lost frames; those of a Tac3D sensor by default.
        depth: of the markers below the elastomer's surface, where they rotate less [mm].
        unloaded: number of frames before the path begins.
        moved: displacement of the markers along the path, if it is known [mm].

    Returns:
        The recording, and its truth, in which `stick` marks markers that have stuck ever since they
        came under the object, and `stick_radius` is of a disc as large as the sticking cells.

    Raises:
        ValueError: the path is a single contact, the markers have only two dimensions, or the depth
            is below 0.
        RuntimeError: the depth is beyond a layer's base.
    """
    if path.pressure.ndim != 3:
        wanted = "it requires a path of contacts: see contactmodel.solve_path"
        raise ValueError(f"simulate_recording got a single contact; {wanted}")
    if sensor.reference.shape[1] != 3:
        raise ValueError("simulate_recording requires markers with x, y and z; these have x and y")
    camera, points = camera or Camera(), sensor.reference[:, :2]
    if moved is None:
        moved = np.asarray(path.elastomer_displacement_at(points, depth))
    still = np.zeros((unloaded, *sensor.reference.shape))
    positions = sensor.reference + np.concatenate([still, moved])
    truth = _truth(path, points, unloaded)
    force = np.pad(np.asarray(path.force), ((unloaded, 0), (0, 0)))
    source = f"virtual contact from the contact model, seed {camera.seed}"
    perfect = see_all(sensor, positions, force=force, name="virtual-contact", source=source)
    return record(perfect, truth, camera)


def _truth(path: ContactSolution, points: np.ndarray, unloaded: int) -> Truth:
    """The truth of all frames, starting with the unloaded ones."""
    contact, sticking = (
        np.pad(values_at(path.grid, np.asarray(mask), points), ((unloaded, 0), (0, 0)))
        for mask in (path.contact, path.stick)
    )
    axes, on_grid = (path.grid.x, path.grid.y), np.moveaxis(np.asarray(path.slip), (0, 1), (2, 3))
    within = interpn(axes, on_grid, points, bounds_error=False, fill_value=0.0)
    slip = np.pad(np.moveaxis(within, 0, 1), ((unloaded, 0), (0, 0), (0, 0)))
    touching = np.pad(np.asarray(path.contact).any(axis=(1, 2)), (unloaded, 0))
    twist = np.pad(np.asarray(path.pose.twist), (unloaded, 0))
    area = np.asarray(path.stick).sum(axis=(1, 2)) * path.grid.cell_area
    slid = np.logical_or.accumulate(contact & ~sticking, axis=0)
    return Truth(
        angle=np.where(touching, twist, np.nan),
        contact=contact,
        stick=contact & ~slid,
        sticking_now=sticking,
        slip=np.where(contact[..., None], slip, 0.0),
        stick_radius=np.pad(np.sqrt(area / np.pi), (unloaded, 0)),
        moment=np.pad(np.asarray(path.moment), (unloaded, 0)),
        macro_slip=touching & (sticking.sum(axis=1) < MIN_STICK_MARKERS),
        stiffness_ratio=float(stiffness_ratio(path.problem.elastomer, path.problem.object_)),
    )


def values_at(
    grid: Grid, mask: Bool[np.ndarray, "frames nx ny"], points: Float[np.ndarray, "n 2"]
) -> Bool[np.ndarray, "frames n"]:
    """Look up a mask of each frame in the cell of each point [mm]; False outside the grid."""
    index = np.floor(points / grid.spacing + 0.5 * np.asarray(grid.shape)).astype(int)
    inside = ((index >= 0) & (index < grid.shape)).all(axis=1)
    i, j = np.clip(index, 0, np.asarray(grid.shape) - 1).T
    return mask[:, i, j] & inside
