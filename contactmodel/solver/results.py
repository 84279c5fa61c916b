"""How a solve may end."""

import equinox as eqx


class RESULTS(eqx.Enumeration):
    """How a solve ended. All but `successful` and `no_contact` are failures."""

    successful = ""
    no_contact = "the bodies do not touch: the approach is too small"
    at_the_edge = (
        "the contact reaches the edge of the grid: take a larger grid, or a smaller approach or "
        "indenter"
    )
    normal_max_steps = (
        "the pressure did not converge within max_steps: allow more, or a larger rtol"
    )
    friction_max_steps = (
        "the traction did not converge within max_steps: allow more, a larger rtol, or take the "
        "path in smaller steps"
    )
    coupling_max_turns = (
        "pressure and traction did not settle on each other: take the path in smaller steps, or a "
        "smaller friction coefficient (above about 2, dissimilar bodies may have no solution)"
    )
    out_of_touch = (
        "the bodies do not touch, and carry no force and no moment: give a larger approach, or a "
        "normal force"
    )
    beyond_friction = "friction cannot carry the force or moment asked for"
    resultant_max_steps = (
        "no motion was found for the force or moment asked for: give a first guess nearer to it, "
        "or go there in smaller steps"
    )
