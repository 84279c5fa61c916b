"""Results of a solve."""

import equinox as eqx


class RESULTS(eqx.Enumeration):
    """How a solve ended. All but `successful` and `no_contact` are failures.

    Examples:
        >>> from contactmodel import RESULTS, Contact, Grid, HalfSpace, Pose, Rigid, Sphere
        >>> from contactmodel import solve_contact
        >>> gel, grid = HalfSpace(0.2, poisson_ratio=0.5), Grid((24, 24), (24.0, 24.0))
        >>> contact = Contact(gel, Rigid(), Sphere(20.0), grid, 0.5)
        >>> solution = solve_contact(contact, Pose(approach=-0.1), throw=False)
        >>> print(RESULTS[solution.result])
        the bodies do not touch in any cell: the approach is too small, or the grid too coarse
    """

    successful = ""
    no_contact = (
        "the bodies do not touch in any cell: the approach is too small, or the grid too coarse"
    )
    at_the_edge = (
        "the contact reaches the edge of the grid: use a larger grid, or a smaller approach or "
        "indenter (a cylinder has no ends: use an ellipsoid, a height map, or a domed pad)"
    )
    normal_max_steps = "the pressure did not converge within max_steps: increase max_steps or rtol"
    friction_max_steps = (
        "the traction did not converge within max_steps: increase max_steps or rtol, or divide the "
        "path into smaller steps"
    )
    coupling_max_turns = (
        "pressure and traction did not converge together: divide the path into smaller steps, or "
        "use a smaller friction coefficient (above about 2, dissimilar bodies may have no solution)"
    )
    out_of_touch = (
        "the bodies do not touch, and carry no force and no moment: give a larger approach, or a "
        "normal force"
    )
    beyond_friction = "friction cannot carry the requested force or moment"
    resultant_max_steps = (
        "no motion was found for the requested force or moment: start closer to it, or use smaller "
        "steps"
    )
    beyond_turn = (
        "the twist changes by 1 rad or more in one step: divide it into a path of smaller steps, "
        "and convert degrees with np.radians"
    )
    beyond_base = (
        "the approach reaches the rigid base of the layer: use a smaller approach or a thicker "
        "layer, both in mm"
    )
    no_height = (
        "the indenter's height is NaN or infinite in a cell: continue its shape, above the "
        "contact, to the edge of the grid"
    )
