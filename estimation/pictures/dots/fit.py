"""Fit of blurred ellipses to windows of a picture, many at once.

The profile across the rim is that of a straight edge under a Gaussian blur, ½ erfc(t/√2 s), with t
the distance from the rim. It is exact for radii much larger than the blur. For all radii it is
symmetric about the centre, and so does not bias the position.
"""

import numpy as np
from jaxtyping import Float, Float32
from scipy.special import erfc


def model_dots(
    p: Float32[np.ndarray, "n 10"],
    dx: Float32[np.ndarray, " pixels"],
    dy: Float32[np.ndarray, " pixels"],
) -> tuple[Float32[np.ndarray, "n pixels"], Float32[np.ndarray, "n 10 pixels"]]:
    """Grey levels of blurred ellipses, and their derivatives.

    Args:
        p: centre, inverse shape (xx, yy, xy) and blur, then the linear parameters: the dot's grey
            level minus the background's, the background and its two slopes.
        dx: of the pixels, from the window's middle.
        dy: the same along y.
    """
    blur, height = p[:, 5:6], p[:, 6:7]
    inverse = p[:, [2, 4, 4, 3]].reshape(-1, 2, 2)
    arm = np.array([dx, dy]) - p[:, :2, None]
    round_arm = inverse @ arm
    size = np.sqrt(np.einsum("nip,nip->np", round_arm, round_arm) + np.float32(1e-6))
    normal = inverse @ round_arm
    normal /= size[:, None]
    slope = np.sqrt(np.einsum("nip,nip->np", normal, normal) + np.float32(1e-9))
    t = (size - 1.0) / (slope * blur)
    inner = np.float32(0.5) * erfc(t * np.float32(np.sqrt(0.5)))
    bell = np.exp(np.float32(-0.5) * t**2) * np.float32(1.0 / np.sqrt(2.0 * np.pi))
    edge = bell * (-height / blur)
    across = edge / slope
    jacobian = np.empty((len(p), 10, len(dx)), np.float32)
    np.multiply(normal, -across[:, None], out=jacobian[:, :2])
    round_arm *= (across / size)[:, None]
    np.multiply(round_arm, arm, out=jacobian[:, 2:4])
    jacobian[:, 4] = np.einsum("nip,nip->np", round_arm, arm[:, ::-1])
    jacobian[:, 5] = -edge * t
    jacobian[:, 6] = inner
    jacobian[:, 7] = 1.0
    jacobian[:, 8], jacobian[:, 9] = dx, dy
    return np.matmul(p[:, None, 6:], jacobian[:, 6:])[:, 0], jacobian


def fit_windows(
    windows: Float32[np.ndarray, "n side side"], radius: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Fit dots in their windows by Gauss–Newton, all at once.

    Args:
        windows: grey levels; NaN outside the picture.
        radius: typical radius of the dots [px].

    Returns:
        Offset from the window's middle [px], covariance of the offset [px²], inverse shape [1/px],
        contrast, blur [px] and the share of the variance that the fit explains [-].
    """
    gauss_newton_steps = 5
    half = windows.shape[1] // 2
    dy, dx = np.mgrid[-half : half + 1, -half : half + 1].reshape(2, -1).astype(np.float32)
    disc = np.flatnonzero(dx**2 + dy**2 <= (half + 0.5) ** 2)
    dx, dy, value = dx[disc], dy[disc], windows.reshape(len(windows), -1)[:, disc]
    weight = np.isfinite(value).astype(np.float32)
    value = np.where(weight > 0.0, value, np.float32(0.0))
    total = weight.sum(axis=1)
    mean = (value * weight).sum(axis=1) / total
    p = _start(value, mean, radius)
    limit = np.array([0.3 * radius] * 2 + [0.25 / radius] * 3 + [0.4])
    for _ in range(gauss_newton_steps):
        matrix, right, _ = _equations(p, value, weight, dx, dy)
        change = np.linalg.solve(matrix, right[..., None])[..., 0]
        share = np.max(np.abs(change[:, :6]) / limit, axis=1, keepdims=True)
        p = (p + change / np.maximum(share, 1.0)).astype(np.float32)
        p[:, 5] = np.clip(p[:, 5], 0.3, 0.8 * radius)
    matrix, _, residual = _equations(p, value, weight, dx, dy)
    variance = (residual**2).sum(axis=1) / np.maximum(total - 10.0, 1.0)
    inverse = np.linalg.solve(matrix, np.broadcast_to(np.eye(10, 2), (len(p), 10, 2)))
    spread = (((value - mean[:, None]) * weight) ** 2).sum(axis=1)
    shape = np.stack([p[:, 2], p[:, 4], p[:, 4], p[:, 3]], axis=1).reshape(-1, 2, 2)
    return (
        p[:, :2],
        inverse[:, :2] * variance[:, None, None],
        shape,
        -p[:, 6],
        p[:, 5],
        1.0 - (residual**2).sum(axis=1) / np.maximum(spread, 1e-6),
    )


def _start(
    value: Float32[np.ndarray, "n pixels"], mean: Float32[np.ndarray, " n"], radius: float
) -> Float32[np.ndarray, "n 10"]:
    """Initial round dots of the typical radius, with grey levels from the windows."""
    middle = value[:, value.shape[1] // 2]
    edge_level = 1.5 * mean - 0.5 * middle
    p = np.zeros((len(mean), 10), np.float32)
    p[:, 2:4], p[:, 5] = 1.0 / radius, 1.0  # xx and yy, and blur
    p[:, 6], p[:, 7] = middle - edge_level, edge_level
    return p


def _equations(
    p: Float32[np.ndarray, "n 10"],
    value: Float32[np.ndarray, "n pixels"],
    weight: Float32[np.ndarray, "n pixels"],
    dx: Float32[np.ndarray, " pixels"],
    dy: Float32[np.ndarray, " pixels"],
) -> tuple[
    Float[np.ndarray, "n 10 10"], Float[np.ndarray, "n 10"], Float32[np.ndarray, "n pixels"]
]:
    """Slightly damped matrix and right side of a Gauss–Newton step, and the residual."""
    fitted, jacobian = model_dots(p, dx, dy)
    jacobian *= weight[:, None]
    residual = (value - fitted) * weight
    matrix = (jacobian @ jacobian.transpose(0, 2, 1)).astype(float)
    diagonal = np.einsum("nii->ni", matrix)  # a view
    diagonal *= 1.0 + 1e-5
    diagonal += 1e-6
    return matrix, np.matmul(jacobian, residual[..., None])[..., 0].astype(float), residual
