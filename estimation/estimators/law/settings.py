"""How a contact is followed by the law of friction."""

from dataclasses import dataclass, field

from estimation.estimators.law.state import LawModel
from estimation.fields.face import FacePrior


@dataclass(frozen=True)
class LawSettings:
    """How a contact is followed.

    Attributes:
        start_deg: rotation from which the law is fitted [°].
        edges: number of last edges whose median is the first guess at the contact.
        worst_misfit: mean square of the residuals over their variance, above which the law does not
            explain a frame [-].
        first_misfit: the same of the first frame, from which all others start [-].
        patience: unexplained frames after which the contact is fitted anew, and between two tries
            [frames].
        doubt: standard errors of the angle per standard error of the fit [-].
        discrepancy: standard error of the angle by what the law leaves out, over the largest angle
            so far times a/c − 1, a and c the radii of the contact and of the disc that has never
            slipped [-].
        elongated: what the outline's stretch adds to it [-].
        rigid: standard error of the angle of markers that have never slipped, by strain in their
            disc, over the largest angle so far [-].
        flat: how far the object may be ahead of the angle under a flat face, over that angle times
            (a²/c² − 1)/2 [-].
        closed: radius of the disc that sticks over the third marker's distance from the centre,
            below which the angle is lost [-].
        closing: the same for the angle less its standard error [-].
        near: the same below which the disc may have closed unseen [-].
        sheared: distance of the point about which the object turns from the contact's centre, over
            the disc's radius, from which other markers than the disc's may slip last [-].
        firmly: radius of the inner part of a disc over the disc's, whose markers count in any case
            after the turn back [-].
        hidden: standard error by slip of the outer markers that the noise hides, over the noise
            that they average out [-].
        clearly: cost by which a contact that slides must fit its first frame better than one that
            sticks all over [-].
        turn_deg: smallest turn back that ends the first turn [°].
        spread: standard deviations of a contact's parameters about the fitted edge.
        outlined: standard deviations of the parameters of a contact without z, about the outline of
            its region; those of the centre over the radius. Those of the outline are at least its
            error.
        drift: standard deviations of their changes from frame to frame.
        model: how far the contact may deviate from the law.
    """

    start_deg: float = 0.4
    edges: int = 4
    worst_misfit: float = 1.6
    first_misfit: float = 1.2
    patience: int = 4
    doubt: float = 1.2
    discrepancy: float = 0.0006
    elongated: float = 0.003
    rigid: float = 0.0002
    flat: float = 0.005
    closed: float = 0.85
    closing: float = 0.97
    near: float = 1.1
    sheared: float = 0.5
    firmly: float = 0.75
    hidden: float = 0.5
    clearly: float = 10.0
    turn_deg: float = 0.3
    spread: tuple[float, ...] = (0.1, 0.1, 0.05, 0.05, 0.05, 0.1, 0.15, 30.0, 0.03, 0.03, 0.01)
    outlined: tuple[float, ...] = (
        *(0.05, 0.05, 0.1, 0.1, 0.1),
        *FacePrior().spread,
        *(30.0, 0.1, 0.1, 0.01),
    )
    drift: tuple[float, ...] = (
        *(0.01, 0.01, 0.003, 0.005, 0.005, 0.01, 0.02, 0.03, 0.003, 0.003, 0.0),
    )
    model: LawModel = field(default_factory=LawModel)
