"""Corners of rendered squares: how near to the truth, and whether the fit knows how near."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest

from tirgeo_ros.core.calibration.checkerboard.board import Checkerboard, steps_of
from tirgeo_ros.core.calibration.checkerboard.corner_fit import fit_corners
from tirgeo_ros.core.camera.camera_model import XT2
from tirgeo_ros.tools.simulate.board import BoardLook, BoardRenderer, calibration_poses

BOARD = Checkerboard(9, 6, 0.1)
LOOK = BoardLook()


@cache
def renderer():
    return BoardRenderer(XT2, BOARD)


def view(look, seed=1, number=0):
    rng = np.random.default_rng(seed)
    poses = list(calibration_poses(XT2, BOARD, number + 1, rng))
    return renderer().view(*poses[number], look, rng)


def fitted(seen, off_px=0.7, seed=2):
    """The fit from places that a detector could have given."""
    off = np.random.default_rng(seed).uniform(-off_px, off_px, seen.corners_px.shape)
    begun = seen.corners_px + off
    return fit_corners(seen.image.astype(np.float32), begun, steps_of(begun, BOARD))


LOOKS = {
    "plain": LOOK,
    "inverted": replace(LOOK, board=LOOK.foil, foil=LOOK.board),
    "blurred": replace(LOOK, blur_px=1.8),
    "uneven foil": replace(LOOK, unevenness=6.0),
    "noisy": replace(LOOK, noise=4.0),
    "16 bit": replace(LOOK, bits=16),
}


@pytest.mark.parametrize("look", LOOKS.values(), ids=LOOKS)
def test_errors_are_those_that_the_fit_tells(look):
    seen = view(look)
    fit = fitted(seen)
    errors = fit.uv - seen.corners_px
    chi2 = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(fit.covariance), errors)
    # 54 corners, 2 degrees of freedom each: the mean is 2 +- 0.27; 1 px is not told by the rest.
    assert 1.2 < chi2.mean() < 3.0
    assert np.isfinite(fit.uv).all()


def test_corners_are_better_than_opencvs_where_foil_is_uneven():
    seen = view(LOOK)
    start = seen.corners_px.astype(np.float32)[:, None].copy()
    stop = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 50, 1e-3)
    theirs = cv2.cornerSubPix(seen.image, start, (8, 8), (-1, -1), stop)[:, 0]
    ours = fitted(seen).uv

    def rms(uv):
        return np.sqrt(((uv - seen.corners_px) ** 2).mean())

    assert rms(ours) < 0.05  # of a coordinate: a tenth of the 0.5 px that a calibration may have
    assert rms(ours) < rms(theirs) / 2


@pytest.mark.parametrize("blur_px", [0.8, 1.3, 2.0])
def test_the_blur_is_found(blur_px):
    fit = fitted(view(replace(LOOK, blur_px=blur_px, noise=0.5)))
    expected = np.hypot(blur_px, 1 / np.sqrt(12))  # the optics' and the pixel's own width
    assert np.median(fit.blur_px) == pytest.approx(expected, rel=0.1)


def test_what_is_beside_the_picture_is_nan():
    image = np.zeros((40, 40), np.float32)
    uv = np.array([[1.0, 20.0], [20.0, 20.0], [39.0, 38.0]])
    steps = np.tile(np.array([[[20.0, 0.0], [0.0, 20.0]]]), (3, 1, 1))
    fit = fit_corners(image, uv, steps)
    assert np.isnan(fit.uv[[0, 2]]).all()
    assert np.isnan(fit.contrast[[0, 2]]).all()
